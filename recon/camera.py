"""Cameras: what is seen. Solvers are how it is computed, and neither knows the other.

With the wall field of frequency omega focused on voxel v by the scanned aperture,

    F(v, omega) = sum_p a_p H^(p, omega) exp(i omega r_p(v)/c) / r_p(v),
    H^(p, omega) = sum_n H[p, n] exp(-i omega t_n)

every camera is a choice of light g(omega), of the moments t at which a voxel is read, and of weights a_p over
the aperture:

    U(v, t) = sum_omega g(omega) exp(i omega t) F(v, omega),   I = |U|^2

Where each position has a detector spot of its own (confocal data, or pairs), both paths are in the kernel:
r_p + r_c in place of r_p in the phase, and t counts from the moment at which light that was scattered once
by v is focused.

By reciprocity the one detector spot x_c of a scan is the virtual point source, and the laser spots are the
camera's aperture: the source flashes at t = 0, and its light reaches v at r_c(v)/c.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from recon.errors import GeometryError, ParameterError
from recon.wave import ContinuousWave, Light, VirtualPulse


@dataclass(frozen=True)
class Plane:
    """Voxels at one depth, and where they are seen from.

    Attributes
    ----------
    x_m, y_m
        (1, nx) and (ny, 1) coordinates of voxels.
    z_m
        Depth.
    detector_m
        (3,) the one detector spot, or None where each position has its own.
    """

    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    z_m: float
    detector_m: NDArray[np.float64] | None


class Camera(ABC):
    """A virtual camera on the wall; a new one needs a name and `reading_times_s`."""

    name: str

    @abstractmethod
    def reading_times_s(self, plane: Plane) -> NDArray[np.float64]:
        """Return the moments at which the voxels of a plane are read.

        Returns
        -------
        ndarray
            (T, ny or 1, nx or 1) float64 times t [s], one for each frame; T is the same for all planes.

        Raises
        ------
        GeometryError
            If the camera makes no sense for such a scan.
        """

    def light(self, pulse: VirtualPulse) -> Light:
        """Return the virtual illumination, g(omega); by default the pulse itself."""
        return pulse

    def aperture_weights(self, laser_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the weight a_p of each of the (P, 3) positions; by default one."""
        return np.ones(len(laser_m))


class ConfocalCamera(Camera):
    """The confocal time-gated camera: each voxel is read when once-scattered light from it arrives.

    t(v) = r_c(v)/c (paper, equations S.19 to S.22), or 0 where each position has its own detector spot.
    """

    name = "confocal"

    def reading_times_s(self, plane: Plane) -> NDArray[np.float64]:
        """Return r_c/c, (1, ny, nx), or (1, 1, 1) zero."""
        spot_m = plane.detector_m
        if spot_m is None:
            return np.zeros((1, 1, 1))
        across = (plane.x_m - spot_m[0]) ** 2 + (plane.y_m - spot_m[1]) ** 2
        return np.sqrt(across + (plane.z_m - spot_m[2]) ** 2)[None] / C_M_PER_S


class PhotoCamera(Camera):
    """The photo camera: one frequency, refocused plane by plane (paper, supplement C.2 and D.1).

    I(v) = |F(v, omega_0)|^2 does not change in time, and needs neither the place nor the timing of the
    detector spot, which is its lamp.
    """

    name = "photo"

    def light(self, pulse: VirtualPulse) -> Light:
        """Return the pulse's carrier alone."""
        return ContinuousWave(pulse.wavelength_m)

    def reading_times_s(self, plane: Plane) -> NDArray[np.float64]:
        """Return zero, (1, 1, 1): any moment gives the same image."""
        return np.zeros((1, 1, 1))


@dataclass(frozen=True)
class TransientCamera(Camera):
    """The transient camera: a video of the flash of one point source (paper, supplement C.2 and D.3).

    The source is the scan's one detector spot, by reciprocity, and flashes at t = 0. Light that is scattered
    once (third bounce) is seen at v at t = r_c(v)/c; light that comes to v by way of another surface, later.

    Attributes
    ----------
    times_s
        (T,) moments of the frames.

    Raises
    ------
    ParameterError
        If there are no frames.
    """

    times_s: NDArray[np.float64]
    name = "transient"

    def __post_init__(self) -> None:
        if np.size(self.times_s) == 0:
            raise ParameterError("transient camera", "a video", "it has no frames", "Give it times to show.")

    def reading_times_s(self, plane: Plane) -> NDArray[np.float64]:
        """Return the frames' moments, (T, 1, 1)."""
        spot_m = plane.detector_m
        if spot_m is None:
            raise GeometryError(
                "transient camera",
                "a video of the flash of one point source",
                "each position of this scan has its own detector spot, so that there is no one source",
                "Use a scan with one detector spot, or the confocal or the photo camera.",
            )
        return np.asarray(self.times_s, np.float64)[:, None, None]
