"""Light from laser spots over a hidden scene to detector spots."""
