"""Many detector spots as one: each pair of laser and detector spot becomes a pair of a virtual aperture.

A detector spot x_c that lies by d beside a chosen spot x_0, x_c = x_0 + d, sees a voxel v over the path

    |x_p - v| + |x_0 + d - v|  =  |x_p + d - v| + |x_0 - v|  +  d . (u_p - u_c) + O(d^2/r),

with the unit vectors u_p and u_c from the voxel to the laser spot and to x_0: to first order, moving the
detector spot is moving the laser spot the same way, where both are seen from the voxel in the same
direction. So the pair (x_p, x_c) is taken as (x_p + d, x_0): all pairs share one detector spot, and laser
spots fill the gaps between each other. This is the remapping of Nam et al., Nature Communications 12:6526
(2021), Fig. 2; the path is wrong by d . (u_p - u_c), at most |d| |x_p - x_0| / depth about, which
`path_error_m` gives exactly.

Without it each detector spot costs a propagation of its own (`recon.solvers.rsd.dispatch`).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from recon.capture import Capture


def remapped(capture: Capture) -> Capture:
    """Return a capture of several detector spots as one of a virtual aperture and one detector spot.

    The one spot is the mean of all. A capture that has one already, or is confocal, is given back.
    """
    if not capture.round_trip or capture.confocal:
        return capture
    centre_m = np.unique(np.round(capture.detector_m, 9), axis=0).mean(axis=0)
    aside_m = capture.detector_m - centre_m
    aside_m[:, 2] = 0.0
    return replace(capture, laser_m=capture.laser_m + aside_m, detector_m=centre_m[None])


def path_error_m(capture: Capture, voxel_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by how much longer each pair's path by a voxel is on the virtual aperture, (P,) [m]."""
    virtual = remapped(capture)
    return _paths_m(virtual, voxel_m) - _paths_m(capture, voxel_m)


def _paths_m(capture: Capture, voxel_m: NDArray[np.float64]) -> NDArray[np.float64]:
    there_m, back_m = capture.laser_m - voxel_m, capture.detector_m - voxel_m
    lengths_m: NDArray[np.float64] = np.linalg.norm(there_m, axis=1) + np.linalg.norm(back_m, axis=1)
    return lengths_m
