"""Laser, wall, lens and cameras: nothing here knows a hidden scene or a wire."""
