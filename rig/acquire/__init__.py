"""Measuring: devices opened by their kind, a plan run, photons recorded, scans taken up again.

Nothing here draws or images.
"""
