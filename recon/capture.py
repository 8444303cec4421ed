"""What imaging starts from: histograms, and where and when they were taken."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

#: Speed of light in vacuum [m/s], exact by definition.
C_M_PER_S = 299_792_458.0
#: Positions in a block of the record, and bytes, as the readers of this program make them; one that holds a
#: single position, or a single chunk of a file, may have more bytes.
BLOCK_POSITIONS, BLOCK_BYTES = 1024, 8 * 2**20
#: Bytes of a piece of a block, of which copies are made: it fits the cache of a processor.
PIECE_BYTES = 2 * 2**20

#: Some of a capture's positions: a run of them, or their numbers.
Positions = slice | NDArray[np.intp]


def pieces(positions: int, bins: int) -> Iterator[slice]:
    """Yield slices of a block's positions, each of `PIECE_BYTES` in single precision, or of one position."""
    step = max(1, PIECE_BYTES // max(1, 4 * bins))
    for start in range(0, positions, step):
        yield slice(start, min(start + step, positions))


class Histograms(Protocol):
    """Photon counts of many positions, readable in blocks, so that a file need not fit in memory."""

    @property
    def shape(self) -> tuple[int, int]:
        """Number of positions and number of bins."""
        ...

    def blocks(self, bins: slice = slice(None)) -> Iterator[tuple[slice, NDArray]]:
        """Yield (positions, counts) in order, each position once; counts are (block, bins)."""
        ...


@dataclass(frozen=True)
class ArrayHistograms:
    """Histograms that are in memory already.

    Attributes
    ----------
    counts
        (positions, bins), any real type.
    block_positions
        Positions in a block.
    """

    counts: NDArray
    block_positions: int = BLOCK_POSITIONS

    @property
    def shape(self) -> tuple[int, int]:
        """Number of positions and number of bins."""
        return self.counts.shape

    def blocks(self, bins: slice = slice(None)) -> Iterator[tuple[slice, NDArray]]:
        """Yield (positions, counts), in order."""
        for start in range(0, len(self.counts), self.block_positions):
            block = slice(start, min(start + self.block_positions, len(self.counts)))
            yield block, self.counts[block, bins]


@dataclass(frozen=True)
class UnreadHistograms:
    """Histograms that are elsewhere: of a part of an image whose spectra are given.

    Attributes
    ----------
    shape
        Number of positions and number of bins.
    """

    shape: tuple[int, int]

    def blocks(self, bins: slice = slice(None)) -> Iterator[tuple[slice, NDArray]]:
        """Raise `ValueError`: there is nothing to read."""
        raise ValueError("the histograms are not in memory; give their spectra")


@dataclass(frozen=True, eq=False)
class Capture:
    """A scan in rectified time: t = 0 when the pulse is on the wall, and only wall, object, wall remains.

    Frame: right-handed, origin at the centre of the relay wall, y up, z out of the wall into the hidden
    scene, x to the right for one who faces the wall; metres.

    Attributes
    ----------
    histograms
        Counts H[p, n] of P positions and B bins.
    bin_width_s
        Width of a bin.
    first_bin_s
        (1,) or (P,): left edge of bin 0 in rectified time. It differs between positions where the record was
        taken in the laser's time, because the paths to and from the wall differ.
    laser_m
        (P, 3) laser spots x_p on the wall.
    detector_m
        (1, 3) one detector spot x_c, or (P, 3) one for each position.

    Examples
    --------
    Two positions, 30 cm apart, seen at the middle of the wall; 500 bins of 20 ps that begin with the pulse
    on the wall:

    >>> import numpy as np, recon
    >>> capture = recon.Capture(
    ...     histograms=recon.ArrayHistograms(np.zeros((2, 500), np.uint32)),
    ...     bin_width_s=20e-12,
    ...     first_bin_s=np.zeros(1),
    ...     laser_m=np.array([[-0.15, 0.0, 0.0], [0.15, 0.0, 0.0]]),
    ...     detector_m=np.zeros((1, 3)),
    ... )
    >>> capture.positions, capture.bins, capture.confocal
    (2, 500, False)
    """

    histograms: Histograms
    bin_width_s: float
    first_bin_s: NDArray[np.float64]
    laser_m: NDArray[np.float64]
    detector_m: NDArray[np.float64]

    @property
    def positions(self) -> int:
        """Number of positions P."""
        return self.histograms.shape[0]

    @property
    def bins(self) -> int:
        """Number of bins B."""
        return self.histograms.shape[1]

    def begins_s(self, positions: Positions) -> NDArray[np.float64]:
        """Return the left edge of bin 0 in rectified time for some positions: (block,), or (1,) for all."""
        return self.first_bin_s if len(self.first_bin_s) == 1 else self.first_bin_s[positions]

    def begin_m(self, positions: slice, first: int = 0) -> NDArray[np.float64]:
        """Return the path c t in rectified time at the left edge of a bin, for some positions, (block,)."""
        first_bin_s = np.broadcast_to(self.first_bin_s, self.positions)[positions]
        return C_M_PER_S * (first_bin_s + first * self.bin_width_s)

    @property
    def confocal(self) -> bool:
        """Whether each position is lit and seen at the same spot."""
        return self.detector_m.shape == self.laser_m.shape and bool(
            np.allclose(self.detector_m, self.laser_m, atol=1e-4)
        )

    def by_its_finer_aperture(self) -> "Capture":
        """Return the capture with the spots that focus as its laser spots.

        Light takes the same paths both ways, so that lasers and detectors may change places. The aperture is
        the side with more spots; where the other is one spot, it is the one detector spot.
        """
        if not self.round_trip or self.confocal:
            return self
        sides = [np.unique(spots_m, axis=0) for spots_m in (self.laser_m, self.detector_m)]
        swapped = len(sides[0]) < len(sides[1])
        aperture_m, other_m = (self.detector_m, self.laser_m) if swapped else (self.laser_m, self.detector_m)
        one_m = sides[0] if swapped else sides[1]
        return replace(self, laser_m=aperture_m, detector_m=one_m if len(one_m) == 1 else other_m)

    @property
    def round_trip(self) -> bool:
        """Whether each position has a detector spot of its own: the same spot, or another of a pair."""
        return len(self.detector_m) > 1 or self.confocal
