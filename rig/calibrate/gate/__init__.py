"""The gate: what of a pulse passes its opening edge, and when to open it."""
