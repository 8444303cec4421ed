"""Earlier methods, written from their papers' equations, to compare the phasor-field camera with.

All take a capture and voxels, and give values that are linear in photon counts, so that they stand beside the
amplitude |U| of the virtual camera, and their squares beside its intensity.
"""
