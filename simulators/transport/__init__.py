"""Light from laser spots over a hidden scene to detector spots: nothing here knows a device or a bench."""
