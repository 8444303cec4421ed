"""Imaging: photon counts and geometry in, images out. Arrays only; no hardware, no files."""
