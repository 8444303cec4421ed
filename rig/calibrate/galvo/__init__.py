"""The steering mirror: where the beam meets the wall for each command, by cameras or by times of flight."""
