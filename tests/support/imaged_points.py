"""A hidden point: what a detector counts of it, and where ``rig recon`` shows it."""

import numpy as np

from rig.files import read_volume
from support.scan_files import C_M_PER_S


def point_signal(point_m, laser_m, detector_m, bins, bin_width_s, first_bin_s=0.0):
    """(P, bins) counts of a hidden point: 100 photons of each position, at the time of wall, point, wall.

    ``first_bin_s`` may be (P,), where each position's record begins at a time of its own. The photons are
    shared between the two nearest bins, so that a place found from them is not off by a part of a bin.
    """
    path_m = np.linalg.norm(laser_m - point_m, axis=1) + np.linalg.norm(detector_m - point_m, axis=1)
    at = (path_m / C_M_PER_S - first_bin_s) / bin_width_s - 0.5
    low = np.floor(at).astype(int)
    counts = np.zeros((len(laser_m), bins), "u2")
    upper = np.rint(100 * (at - low)).astype("u2")
    rows = np.arange(len(laser_m))
    counts[rows, low] += 100 - upper
    counts[rows, low + 1] += upper
    return counts


def brightest(rig, scan, *options):
    """Image a scan file by ``rig recon``; return the brightest pixel's x and y, and its depth."""
    done = rig("recon", scan, "--out", "brightest-volume.h5", "--cycles", 2, *options)
    assert done.code == 0, done.err
    volume = read_volume("brightest-volume.h5")
    front = volume.intensity.max(axis=0)
    y, x = np.unravel_index(front.argmax(), front.shape)
    return np.array([volume.x_m[x], volume.y_m[y], volume.depth_m[y, x]])
