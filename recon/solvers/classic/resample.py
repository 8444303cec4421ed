"""The record on a lattice of confocal radii, as the methods that need one read it."""

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from recon.aperture import TOLERANCE_M, Aperture, recognise
from recon.capture import C_M_PER_S, Capture
from recon.errors import GeometryError
from recon.grid import VoxelGrid
from recon.window import Window, windowed_blocks


@dataclass(frozen=True)
class ConfocalLattice:
    """A regular grid of spots, each lit and seen itself, or what comes nearest to it.

    One detector spot x_c and laser spots x_p are taken as confocal at the midpoints (x_p + x_c)/2 by normal
    moveout: with b = |x_p - x_c|, a scatterer straight in front of the midpoint at distance r is reached by
    a path (c t)^2 = 4 r^2 + b^2, so t' = sqrt(t^2 - (b/c)^2) is its confocal time. For one that is seen from
    the midpoint at an angle theta to the line from x_p to x_c the exact path is
    (c t)^2 = 2 s (1 + sqrt(1 - (r b cos(theta)/s)^2)) with s = r^2 + b^2/4, and the distance that results is
    short by about b^2 cos^2(theta)/(8 r) (Yilmaz, Seismic Data Analysis, on dip and moveout; Lindell et al.
    2019, supplement, convert their non-confocal data so).

    Attributes
    ----------
    aperture
        Lattice of the spots; of half the laser's pitch where they are midpoints.
    offset_m
        (P,) distance b; zero where confocal.
    """

    aperture: Aperture
    offset_m: NDArray[np.float64]

    @classmethod
    def of(cls, capture: Capture, solver: str) -> "ConfocalLattice":
        """Recognise it.

        Raises
        ------
        GeometryError
            If the spots are not on a regular grid on z = 0, or there are several detector spots apart from
            the laser's.
        """
        if capture.confocal:
            return cls(recognise(capture.laser_m), np.zeros(capture.positions))
        if len(capture.detector_m) != 1 or abs(capture.detector_m[0, 2]) > TOLERANCE_M:
            raise GeometryError(
                f"solver {solver}",
                "each position lit and seen at the same spot, or one detector spot on the plane z = 0",
                f"there are {len(capture.detector_m)} detector spots, apart from the laser's, up to "
                f"{np.abs(capture.detector_m[:, 2]).max() * 1e3:.1f} mm off the plane",
                "Use a back-projection solver, which takes any pairs.",
            )
        recognise(capture.laser_m)  # refused here, it is named by the spots that the user knows
        middle_m = (capture.laser_m + capture.detector_m) / 2
        return cls(recognise(middle_m), np.linalg.norm(capture.laser_m - capture.detector_m, axis=1))

    @property
    def approximate(self) -> bool:
        """Whether the spots are midpoints."""
        return bool(self.offset_m.any())

    @property
    def shape(self) -> tuple[int, int]:
        """Lattice points along y and x."""
        return self.aperture.y.count, self.aperture.x.count

    def notes(self) -> list[str]:
        """Say what is not as measured."""
        found = []
        if self.approximate:
            found.append(
                "this is an approximation: data of one detector spot were converted to confocal data at the "
                "midpoints by normal moveout, which is exact only straight in front of each midpoint"
            )
        points = self.aperture.row * self.shape[1] + self.aperture.column
        missing = self.shape[0] * self.shape[1] - len(np.unique(points))
        if missing:
            found.append(f"{missing} points of the grid were not measured and are treated as dark")
        return found

    def extent_m(self, grid: VoxelGrid) -> float:
        """Return the greatest distance across, between any spot and any voxel."""
        return float(
            np.hypot(
                *(
                    max(abs(voxels[-1] - spots[0]), abs(spots[-1] - voxels[0]))
                    for voxels, spots in (
                        (grid.x_m, self.aperture.x.coordinates_m),
                        (grid.y_m, self.aperture.y.coordinates_m),
                    )
                )
            )
        )


def confocal_record(
    capture: Capture, lattice: ConfocalLattice, window: Window, edges_m: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Sort counts into shells of confocal radius r = c t'/2.

    Counts are spread evenly over their bin and conserved. Points of the lattice that were measured more than
    once are averaged; those not measured stay dark.

    Parameters
    ----------
    capture
        Histograms.
    lattice
        Its spots.
    window
        Soft edges.
    edges_m
        (R + 1,) edges of the shells, ascending.

    Returns
    -------
    ndarray
        (y, x, R) float32 counts.
    """
    rows, columns = lattice.shape
    record = np.zeros((rows * columns, len(edges_m) - 1), np.float32)
    times_measured = np.zeros(rows * columns, np.float32)
    points = lattice.aperture.row * columns + lattice.aperture.column
    bin_m = C_M_PER_S * capture.bin_width_s
    for block, counts in windowed_blocks(capture, window, slice(0, capture.bins)):
        begin_m = capture.begin_m(block)
        shells = np.empty((len(counts), record.shape[1]), np.float32)
        _into_shells(counts, begin_m, bin_m, lattice.offset_m[block], edges_m, shells)
        np.add.at(record, points[block], shells)
        np.add.at(times_measured, points[block], 1)
    record /= np.maximum(times_measured, 1)[:, None]
    return record.reshape(rows, columns, -1)


@njit(nogil=True, cache=True, parallel=True)
def _into_shells(
    counts: NDArray[np.float32],
    begin_m: NDArray[np.float64],
    bin_m: float,
    offset_m: NDArray[np.float64],
    edges_m: NDArray[np.float64],
    shells: NDArray[np.float32],
) -> None:
    """Difference the running sum of counts between the paths sqrt(4 r^2 + b^2) of the shells' edges."""
    bins = counts.shape[1]
    for p in prange(len(counts)):
        running = np.zeros(bins + 2)
        for n in range(bins):
            running[n + 1] = running[n] + counts[p, n]
        running[bins + 1] = running[bins]
        before = 0.0
        for e in range(len(edges_m)):
            path_m = np.sqrt(4 * edges_m[e] ** 2 + offset_m[p] ** 2)
            at = min(max((path_m - begin_m[p]) / bin_m, 0.0), float(bins))
            n = int(at)
            total = running[n] + (at - n) * (running[n + 1] - running[n])
            if e:
                shells[p, e - 1] = total - before
            before = total
