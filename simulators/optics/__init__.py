"""Laser, wall, lenses and cameras."""
