"""Points of a scan in records that this program wrote while it ran: sweeps of a mirror that never stopped.

A line that failed is in them twice. The head says with which step each sweep began, so the one that counts
is known. The mirror trails its command: the photons of a point are those between two markers, by that much
later.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError
from rig.files.picoquant import EXPOSURE, LAG, POINT_MARKER, STEPS, SWEEPS, Head

if TYPE_CHECKING:
    from rig.importers.tagged import Records, Survey

#: Where no marker follows for so many exposures, ticks without a marker follow: the point has its exposure.
_GAP = 1.5
#: More sync pulses than any scan has.
_MOST = 2.0**50


@dataclass(frozen=True)
class Sweeps:
    """What the head says of the sweeps.

    Attributes
    ----------
    tag, step
        (K,) sync pulse with which each begins, and its first point.
    trusted
        How many points can be trusted; None where nobody said.
    lag
        By how much the mirror trails its command, in sync pulses.
    exposure
        (P,) exposure of each point, in sync pulses; infinite where it is not known.
    """

    tag: NDArray[np.int64]
    step: NDArray[np.int64]
    trusted: int | None
    lag: int
    exposure: NDArray[np.float64]

    @classmethod
    def of(cls, head: Head, points: int) -> Self | None:
        """Read the head; None where these are no sweeps.

        Raises
        ------
        DataFileError
            If it is damaged.
        """
        if SWEEPS not in head.values:
            return None
        pairs = head.numbers(SWEEPS)
        pairs = pairs[: len(pairs) // 2 * 2].reshape(-1, 2)
        pairs = pairs[pairs[:, 0] >= 0]
        unit_s, lag_s = float(head.number("MeasDesc_GlobalResolution")), float(head.number(LAG))
        exposure_s = head.numbers(EXPOSURE)
        sane = (pairs < _MOST).all() and unit_s > 0 and abs(lag_s) < _MOST * unit_s
        if not sane or not ((exposure_s >= 0) & (exposure_s < _MOST * unit_s)).all():
            raise DataFileError(
                f"{head.path}: its header has times that are impossible in a scan; it is damaged"
            )
        tag, step = pairs.T.astype(np.int64)
        if (np.diff(step) < 0).any() or (np.diff(tag) <= 0).any() or ((step < 0) | (step > points)).any():
            raise DataFileError(
                f"{head.path}: the sweeps in its header do not follow one another; it is damaged"
            )
        if len(exposure_s) not in {0, points}:
            raise DataFileError(
                f"{head.path}: its header has {len(exposure_s)} exposures for {points} points; it is damaged"
            )
        steps = int(head.number(STEPS))
        return cls(
            tag,
            step,
            steps if 0 <= steps <= points else None,
            round(lag_s / unit_s),
            exposure_s / unit_s if len(exposure_s) else np.full(points, np.inf),
        )

    def points(
        self, seen: "Survey", records: "Records"
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], list[str]]:
        """Return where the photons of each point begin and end, and what is to be said.

        Raises
        ------
        DataFileError
            If a sweep lacks markers of points that were measured in it, or nothing is whole.
        """
        from rig.importers.tagged import photons_before

        edges = self._edges(seen, records)
        start, stop = photons_before(records, edges.ravel() + self.lag).reshape(-1, 2).T
        if records.truncated:  # the last points' photons may be cut off
            whole = stop < seen.photons
            start, stop = start[whole], stop[whole]
        points, told = len(self.exposure), []
        if not len(start):
            raise DataFileError(f"{records.head.path} holds no complete point of {points:,}")
        if len(start) < points:
            told.append(f"the first {len(start):,} of {points:,} points are in the file")
        if self.trusted is None:
            told.append("these records ended before the scan did: the last points may be invalid")
        return start, stop, told

    def _edges(self, seen: "Survey", records: "Records") -> NDArray[np.int64]:
        """Return (n, 2) the sync pulses between which each point was measured, the mirror's lag aside."""
        until = len(self.exposure) if self.trusted is None else self.trusted
        ends = np.append(self.tag[1:], np.iinfo(np.int64).max)
        last = np.minimum(np.append(self.step[1:], until), until)[: len(self.step)]
        parts = [np.empty((0, 2), np.int64)]
        for number, (first, stop) in enumerate(zip(self.step.tolist(), last.tolist(), strict=True)):
            here = slice(*np.searchsorted(seen.tag, [self.tag[number], ends[number]]))
            edges = self._of_sweep(seen.tag[here], seen.mask[here], first)[: max(0, stop - first)]
            if len(edges) < stop - first and number + 1 < len(self.tag):
                raise DataFileError(
                    f"{records.head.path}: sweep {number + 1} has {len(edges):,} points of "
                    f"{stop - first:,}; it is damaged"
                )
            parts.append(edges)
        return np.concatenate(parts)

    def _of_sweep(self, tag: NDArray[np.int64], mask: NDArray[np.uint8], first: int) -> NDArray[np.int64]:
        """Return (n, 2) where the points of a sweep begin and end; one that no marker follows is left out."""
        point = np.flatnonzero(mask[:-1] & 1 << POINT_MARKER - 1)[: len(self.exposure) - first]
        exposure = self.exposure[first : first + len(point)]
        begin, next_one = tag[point], tag[point + 1]
        alone = next_one - begin > _GAP * exposure
        exposure = np.where(alone, exposure, 0.0)
        return np.stack([begin, np.where(alone, begin + np.rint(exposure).astype(np.int64), next_one)], 1)
