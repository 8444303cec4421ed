"""From the time that the instrument records to rectified time: the delays of the paths outside the scene."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S


@dataclass(frozen=True)
class PathDelays:
    """The paths and delays that a transient in the laser's time contains beside wall, object, wall.

    Attributes
    ----------
    laser_head_m, detector_head_m
        (3,) where light leaves the laser and enters the detector.
    electronics_delay_s
        Delay of cables and electronics.
    """

    laser_head_m: NDArray[np.float64]
    detector_head_m: NDArray[np.float64]
    electronics_delay_s: float = 0.0

    def delay_s(self, laser_m: NDArray, detector_m: NDArray) -> NDArray[np.float64]:
        """Return what to subtract from recorded time to rectify it.

        t_rectified = t_recorded - t_electronics - |x_p - head_laser| / c - |x_c - head_detector| / c
        (Liu et al. 2019, methods: the time origin is moved to the wall).

        Parameters
        ----------
        laser_m, detector_m
            (..., 3) spots x_p and x_c on the wall, which broadcast.

        Returns
        -------
        (...) delays in seconds.
        """
        to_wall_m = np.linalg.norm(laser_m - self.laser_head_m, axis=-1)
        from_wall_m = np.linalg.norm(detector_m - self.detector_head_m, axis=-1)
        return np.asarray(self.electronics_delay_s + (to_wall_m + from_wall_m) / C_M_PER_S)
