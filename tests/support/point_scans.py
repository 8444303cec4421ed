"""Scan files of one hidden point and a few stray photons."""

import h5py
import numpy as np

from recon.capture import C_M_PER_S

POINT = np.array([0.21, 0.13, 0.7])
DETECTOR = np.array([-0.05, 0.05, 0.0])
BIN_S = 16e-12


def write_point_scan(path, shape=(24, 20), spacing_m=0.03):
    """Write a scan in rectified time, positions evenly spread; return its path."""
    columns, rows = ((np.arange(count) - (count - 1) / 2) * spacing_m for count in shape)
    x, y = np.meshgrid(columns, rows)
    laser_m = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    path_m = np.linalg.norm(laser_m - POINT, axis=1) + np.linalg.norm(DETECTOR - POINT)
    counts = np.random.default_rng(3).poisson(0.05, (x.size, 1000)).astype(np.uint32)
    counts[np.arange(x.size), (path_m / C_M_PER_S / BIN_S).astype(int)] += 100
    with h5py.File(path, "w") as file:
        file.attrs["format"], file.attrs["version"] = "rig-scan", 1
        transients = file.create_group("transients")
        transients.attrs["bin_width_s"], transients.attrs["first_bin_s"] = BIN_S, 0.0
        transients.attrs["time_origin"] = "wall"
        transients["counts"] = counts
        file["geometry/laser_m"], file["geometry/detector_m"] = laser_m, DETECTOR[None]
    return path
