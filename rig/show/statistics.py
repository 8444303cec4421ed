"""Photon statistics of a scan, as Table 1 of Liu et al. (2019) gives them, and reduced views of its raw data.

Scans are read block by block; what is kept grows with positions, not with bins.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from recon.capture import Capture
from rig.errors import DataFileError

#: The paper leaves out the first 833 bins of 4 ps: nothing 50 cm from the wall, or farther, is earlier.
FIRST_USEFUL_S = 833 * 4e-12


@dataclass(frozen=True)
class Statistics:
    """What was counted from a time after the pulse on the wall on.

    Attributes
    ----------
    from_s
        That time: bins that begin earlier are left out.
    positions
        Measured positions P.
    bins
        Bins of all positions together.
    photons
        Sum over all of them (a float where the scan holds expectations).
    per_bin, per_position
        Its means.
    largest
        Largest count of a bin.
    """

    from_s: float
    positions: int
    bins: int
    photons: float
    per_bin: float
    largest: float
    per_position: float

    def as_dict(self) -> dict[str, float]:
        """Return the numbers by name; counts of a scan that was counted are whole."""
        found = asdict(self)
        for name in ("photons", "largest"):
            found[name] = int(found[name]) if float(found[name]).is_integer() else found[name]
        return found


@dataclass(frozen=True)
class Tally:
    """Totals of each position.

    Attributes
    ----------
    statistics
        Of the whole scan.
    photons, largest
        (P,) sum and largest bin of each position.
    """

    statistics: Statistics
    photons: NDArray
    largest: NDArray

    @property
    def most(self) -> int:
        """Position with the most photons."""
        return int(self.photons.argmax())

    @property
    def median(self) -> int:
        """Position whose photons are nearest to the median."""
        return int(np.abs(self.photons - np.median(self.photons)).argmin())

    @property
    def peak(self) -> int:
        """Position with the largest bin."""
        return int(self.largest.argmax())


def tally(capture: Capture, from_s: float = FIRST_USEFUL_S) -> Tally:
    """Count the photons of each position from a rectified time on.

    Raises
    ------
    DataFileError
        If the record of every position ends before that time.
    """
    first = np.broadcast_to(first_bins(capture, from_s), capture.positions)
    bins = int((capture.bins - first).sum())
    if bins == 0:
        raise DataFileError(
            f"the record ends before {from_s * 1e9:.3g} ns: there is nothing to count; give an earlier time"
        )
    start = int(first.min())
    photons, largest = np.zeros((2, capture.positions))
    for rows, counts in capture.histograms.blocks(slice(start, None)):
        late = np.arange(start, capture.bins) >= first[rows, None]
        if not late.all():
            counts = np.where(late, counts, 0)
        photons[rows] = counts.sum(axis=1, dtype=np.float64)
        largest[rows] = counts.max(axis=1)
    total = float(photons.sum())
    return Tally(
        Statistics(
            from_s=from_s,
            positions=capture.positions,
            bins=bins,
            photons=total,
            per_bin=total / bins,
            largest=float(largest.max()),
            per_position=total / capture.positions,
        ),
        photons,
        largest,
    )


def first_bins(capture: Capture, from_s: float) -> NDArray[np.int64]:
    """Return (1,) or (P,) the first bin that begins at a rectified time, or after it."""
    # a millionth of a bin for rounding: bin 833 of 4 ps begins at 833 x 4 ps
    with np.errstate(over="ignore"):  # a time far too late is infinitely many bins late
        first = np.ceil((from_s - capture.first_bin_s) / capture.bin_width_s - 1e-6)
    return np.clip(first, 0, capture.bins).astype(np.int64)


def histograms_of(capture: Capture, positions: list[int]) -> list[NDArray]:
    """Return the (bins,) histograms of a few positions."""
    found: dict[int, NDArray] = {}
    for rows, counts in capture.histograms.blocks():
        found |= {p: counts[p - rows.start].copy() for p in positions if rows.start <= p < rows.stop}
        if len(found) == len(set(positions)):
            break
    return [found[p] for p in positions]


@dataclass(frozen=True)
class Streak:
    """All histograms as one image of positions over rectified time.

    Attributes
    ----------
    counts
        (rows, columns) mean counts of the bins in each pixel; NaN where no bin is.
    time_s
        (columns + 1,) rectified time of the pixels' edges.
    positions
        Positions P, line by line of the wall from the bottom up, divided evenly among the rows.
    """

    counts: NDArray[np.float64]
    time_s: NDArray[np.float64]
    positions: int


def streak(capture: Capture, *, rows: int = 600, columns: int = 900, stop_s: float | None = None) -> Streak:
    """Reduce a scan to an image of at most ``rows`` x ``columns`` pixels, by means over blocks.

    Parameters
    ----------
    stop_s
        Rectified time at which the image ends; None: the end of the record.
    """
    width_s = capture.bin_width_s
    start_s, end_s = capture.first_bin_s.min(), capture.first_bin_s.max() + capture.bins * width_s
    end_s = min(end_s, stop_s) if stop_s is not None else end_s
    columns = max(1, min(columns, int((end_s - start_s) / width_s)))
    rows = min(rows, capture.positions)
    time_s = np.linspace(start_s, end_s, columns + 1)
    row_of = _line_by_line(capture.laser_m) * rows // capture.positions
    total, bins = np.zeros((2, rows, columns))
    for block, edge, summed in _summed(capture, time_s):
        np.add.at(total, row_of[block], np.diff(summed, axis=1))
        np.add.at(bins, row_of[block], np.diff(edge, axis=1))
    with np.errstate(invalid="ignore"):
        return Streak(total / bins, time_s, capture.positions)


def _line_by_line(laser_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return (P,) the rank of each position by y, then x, whatever the order of the scan."""
    rank = np.empty(len(laser_m), np.int64)
    rank[np.lexsort((laser_m[:, 0], np.round(laser_m[:, 1], 6)))] = np.arange(len(laser_m))
    return rank


def _summed(capture: Capture, time_s: NDArray[np.float64]) -> Iterator[tuple[slice, NDArray, NDArray]]:
    """Yield for each block its positions, the bin at each time, and the sum of all counts before that bin."""
    for block, counts in capture.histograms.blocks():
        origin_s = np.broadcast_to(capture.first_bin_s, capture.positions)[block, None]
        edge = np.clip(np.ceil((time_s - origin_s) / capture.bin_width_s - 1e-6), 0, capture.bins)
        before = np.zeros((len(counts), capture.bins + 1))
        np.cumsum(counts, axis=1, out=before[:, 1:])
        yield block, edge, np.take_along_axis(before, edge.astype(np.int64), axis=1)
