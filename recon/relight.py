"""Relighting: an exhaustive capture as if the light had been focused on one hidden point.

The lasers' side is focused on a point a of the hidden scene, in each frequency and pixel d,

    H^_a(d, omega) = sum_l H^(l, d, omega) exp(i omega r_l(a)/c) / r_l(a) ,

and what is left is a capture with one lamp, a pulse that is at a at t = 0. The pixels' side is focused on
voxels as that of any other. U_a(v, t) is an element of the virtual light transport matrix from a to v, and
time separates its parts: light scattered by a alone is seen at v = a and t = 0 (direct); light that goes on
from a to v is at v at t = |v - a|/c (first-order indirect); all else is later (higher-order indirect).

After Marco et al., "Virtual light transport matrices for non-line-of-sight imaging", ICCV 2021, in the sign
convention of `recon.imaging.image`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike, NDArray

from recon.camera import Camera, Plane
from recon.capture import C_M_PER_S, ArrayHistograms, Capture
from recon.exhaustive import Exhaustive
from recon.sampling import DepthBlock
from recon.spectrum import spectra
from recon.window import Window

#: Usual memory for the spectra of a run of lasers.
RUN_BYTES = 256 * 2**20


@dataclass(frozen=True)
class Relit:
    """An exhaustive capture with its lasers focused on a point.

    Attributes
    ----------
    capture
        All pairs.
    point_m
        (3,) hidden point a [m].
    run_bytes
        Memory for the spectra of a run of lasers; those of one laser are taken in any case.
    """

    capture: Exhaustive
    point_m: NDArray[np.float64]
    run_bytes: int = RUN_BYTES

    @property
    def to_point_m(self) -> NDArray[np.float64]:
        """(L,) distance r_l of each laser spot from the point [m]."""
        return np.linalg.norm(self.capture.laser_m - self.point_m, axis=1)

    def outline(self) -> Capture:
        """Return the pixels as positions and the point as the one detector spot, to plan with.

        It has no histograms: their spectra come from `spectra`. Time is counted from the light at the point;
        where the first bin begins differs between pairs, of which the least and the greatest are here.
        """
        whole = self.capture
        begins_s = whole.first_bin_s - self.to_point_m[:, None] / C_M_PER_S
        first_bin_s = np.full(len(whole.pixel_m), begins_s.min())
        first_bin_s[-1] = begins_s.max()
        unread = ArrayHistograms(np.broadcast_to(np.uint8(0), (len(first_bin_s), whole.histograms.bins)))
        return Capture(unread, whole.bin_width_s, first_bin_s, whole.pixel_m, self.point_m[None])

    def spectra(
        self,
        _: Capture,
        depth_blocks: Sequence[DepthBlock],
        window: Window,
        progress: Callable[[float], None] | None = None,
        dtype: DTypeLike = np.complex64,
    ) -> list[NDArray[np.complexfloating]]:
        """Return H^_a of all pixels, (F, D) for each depth block; parameters as of `recon.spectrum.spectra`.

        Lasers are taken by runs, one after the other.
        """
        whole, pixels = self.capture, len(self.capture.pixel_m)
        total: list[NDArray[np.complexfloating]] = [
            np.zeros((part.reached * len(part.band), pixels), dtype) for part in depth_blocks
        ]
        of_laser = np.dtype(dtype).itemsize * sum(map(np.size, total))
        run = max(1, self.run_bytes // max(1, of_laser))
        for first in range(0, whole.lasers, run):
            lasers = slice(first, min(first + run, whole.lasers))
            found = spectra(whole.pairs_of(lasers), depth_blocks, window, None, dtype)
            r_l = self.to_point_m[lasers]
            for sum_, part, one in zip(total, depth_blocks, found, strict=True):
                if part.reached:
                    turns = np.multiply.outer(part.band.frequencies_rad_per_s, r_l / C_M_PER_S)
                    focusing = (np.exp(1j * turns) / r_l).astype(dtype)
                    sum_ += np.einsum("fl,fld->fd", focusing, one.reshape(len(one), len(r_l), pixels))
            if progress:
                progress(lasers.stop / whole.lasers)
        return total


@dataclass(frozen=True)
class SeparatingCamera(Camera):
    """Reads each voxel at t = 0, when light from the lit point comes straight, and at later moments.

    Frame 0 is the direct light, frame 1 the first-order indirect light, and what follows is of higher orders.
    Nearer to the point than the pulse is long the first two are one.

    Attributes
    ----------
    later_s
        (n,) moments after the arrival of light straight from the point.
    """

    later_s: NDArray[np.float64]
    name = "separating"

    def reading_times_s(self, plane: Plane) -> NDArray[np.float64]:
        """Return the moments, (2 + n, y, x)."""
        assert plane.detector_m is not None
        across = (plane.x_m - plane.detector_m[0]) ** 2 + (plane.y_m - plane.detector_m[1]) ** 2
        straight_s = np.sqrt(across + (plane.z_m - plane.detector_m[2]) ** 2) / C_M_PER_S
        later = straight_s + np.asarray(self.later_s, np.float64)[:, None, None]
        return np.concatenate([np.zeros_like(straight_s)[None], straight_s[None], later])
