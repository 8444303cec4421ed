"""Measuring: devices opened by their kind, a plan run, photons recorded, scans taken up again. It neither draws
nor images."""
