"""Where the laser was at each point of a scan whose file holds photons and markers, or curves, alone.

The places come from the file itself, where this program wrote it, from another scan file of the same plan, or
from a grid that a person names.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError, UsageError
from rig.files import ScanFile
from rig.files.picoquant import (
    BINS,
    DELAY,
    DETECTOR,
    FADE,
    FIRST_BIN,
    INPUTS,
    LASER,
    Head,
)
from rig.importers.options import Options, positive

#: More points than any plan has.
_MOST_POINTS = 5_000_000
#: Inputs that records can name: six bits.
_MOST_INPUTS = 64


@dataclass(frozen=True)
class Visits:
    """Where the laser was, and where the detector looked, in the order of time.

    Attributes
    ----------
    laser_m
        (P, 3) spots.
    detector_m
        (1 or P, C, 3) spots of each channel.
    inputs
        Inputs of the channels, where the file says them.
    columns
        Points in a line; None where lines differ or are not known.
    first_bin_s
        Left edge of dtime 0, where t = 0 is the pulse on the wall, or at the laser where there are delays.
    delay_s
        (P, C) what to subtract for rectified time; None where that is nothing.
    fade_from_s
        Rectified time before which the record holds the wall's own light, where known.
    bins
        How many bins there are, where known.
    assumed
        What was taken for granted.
    """

    laser_m: NDArray[np.float64]
    detector_m: NDArray[np.float64]
    inputs: tuple[int, ...] | None = None
    columns: int | None = None
    first_bin_s: float = 0.0
    delay_s: NDArray[np.float64] | None = None
    fade_from_s: float | None = None
    bins: int | None = None
    assumed: tuple[str, ...] = ()

    @property
    def points(self) -> int:
        """Number of points P."""
        return len(self.laser_m)

    @property
    def channels(self) -> int:
        """Number of channels C."""
        return self.detector_m.shape[1]

    def place(self, point: int) -> str:
        """Return which point this is, in words; all are counted from 1."""
        if self.columns is None:
            return f"point {point + 1}"
        return f"line {point // self.columns + 1}, point {point % self.columns + 1}"

    def pairs(
        self, points: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64] | None]:
        """Return laser spots, detector spots and delays of the first points, each with each channel."""
        laser_m = np.repeat(self.laser_m[:points], self.channels, axis=0)
        detector_m = self.detector_m.reshape(-1, 3)
        if len(self.detector_m) > 1 or self.channels > 1:
            seen_m = np.broadcast_to(self.detector_m, (self.points, self.channels, 3))
            detector_m = seen_m[:points].reshape(-1, 3)
        return laser_m, detector_m, None if self.delay_s is None else self.delay_s[:points].ravel()


def visits(head: Head, options: Options) -> Visits:
    """Return the places of a scan: a person's, or the file's own.

    Raises
    ------
    UsageError
        If they are not known, and were not given.
    DataFileError
        If those of the file, or of the other file, do not fit together.
    """
    if LASER in head.values:
        return _own(head)
    like = options.optional("places")
    if like is not None:
        if options.optional("grid") is not None:
            raise UsageError("--places and --grid both give the places of the laser; leave one of them out")
        return _of_scan(Path(like), options)
    return _of_grid(head.path, options)


def _own(head: Head) -> Visits:
    laser_m, inputs = head.numbers(LASER), head.numbers(INPUTS)
    detector_m, channels = head.numbers(DETECTOR), len(inputs)
    points = len(laser_m) // 3
    if (
        not np.isin(inputs, np.arange(_MOST_INPUTS)).all()
        or len(np.unique(inputs)) != channels
        or not channels
    ):
        raise DataFileError(
            f"{head.path}: the tag {INPUTS} of its header must hold different whole numbers from 0 to "
            f"{_MOST_INPUTS - 1}, the inputs of the channels; it is damaged"
        )
    if (
        len(laser_m) != 3 * points
        or len(detector_m) not in {3 * channels, 3 * channels * points}
        or not points
    ):
        raise DataFileError(
            f"{head.path}: its header has {len(laser_m)} numbers of laser spots and {len(detector_m)} of "
            f"detector spots, which are not three for each of {points} points and {channels} channels"
        )
    delay_s = head.numbers(DELAY) if DELAY in head.values else None
    if delay_s is not None and len(delay_s) != points * channels:
        raise DataFileError(
            f"{head.path}: its header has {len(delay_s)} delays for {points * channels} pairs"
        )
    return Visits(
        laser_m.reshape(points, 3),
        detector_m.reshape(-1, channels, 3),
        inputs=tuple(int(one) for one in inputs),
        first_bin_s=float(head.number(FIRST_BIN)),
        delay_s=None if delay_s is None else delay_s.reshape(points, channels),
        fade_from_s=float(head.number(FADE)) if FADE in head.values else None,
        bins=int(head.number(BINS)),
    )


def _of_scan(path: Path, options: Options) -> Visits:
    """Take the places of another scan file, in the order in which it has them."""
    with ScanFile(path) as scan:
        capture = scan.capture()
    return Visits(
        capture.laser_m,
        capture.detector_m[:, None],
        first_bin_s=-_zero_s(options),
        assumed=(f"places, and their order, are those of {path.name}", *_said_of_zero(options)),
    )


def _of_grid(path: Path, options: Options) -> Visits:
    """Lay out the grid that a person names."""
    columns, rows = options.asked(
        "grid", path, "where the laser was", "or the scan file of the same plan with --places"
    )
    if columns * rows > _MOST_POINTS:
        raise UsageError(
            f"--grid {columns}x{rows} has more than {_MOST_POINTS:,} points, more than a plan can have"
        )
    spacing_m = positive(options.asked("spacing_m", path, "how far apart the spots are"), "--spacing")
    seen = options.asked("detector", path, "where the detector looks", "confocal, or its spot, e.g. 10cm,0cm")
    laser_m, told = _grid(columns, rows, spacing_m, options)
    confocal = isinstance(seen, str)
    return Visits(
        laser_m,
        laser_m[:, None] if confocal else np.array([[[*seen, 0.0]]], float),
        columns=columns,
        first_bin_s=-_zero_s(options),
        assumed=(told, *_said_of_zero(options)),
    )


def _grid(columns: int, rows: int, spacing_m: float, options: Options) -> tuple[NDArray[np.float64], str]:
    """Return the (P, 3) spots of a grid about the wall's centre in the order of visits, and that in words."""
    order = str(options.optional("order") or "x,y").replace(" ", "")
    fast, _, slow = order.partition(",")
    if {fast.strip("+-"), slow.strip("+-")} != {"x", "y"} or max(len(fast), len(slow)) > 2:
        raise UsageError(f"--order {order}: write the axis along a line, then the next, e.g. x,y or y,-x")
    along = (np.arange(columns) - (columns - 1) / 2) * (-spacing_m if fast[0] == "-" else spacing_m)
    across = (np.arange(rows) - (rows - 1) / 2) * (-spacing_m if slow[0] == "-" else spacing_m)
    grid_m = np.zeros((rows, columns, 3))
    axis = "xy".index(fast[-1])
    grid_m[..., axis], grid_m[..., 1 - axis] = along, across[:, None]
    snake = bool(options.optional("snake"))
    if snake:
        grid_m[1::2] = grid_m[1::2, ::-1]
    every = ", every other line backwards" if snake else ", all lines in one direction"
    return grid_m.reshape(-1, 3), f"lines run along {fast}, and follow one another along {slow}{every}"


def _zero_s(options: Options) -> float:
    return float(options.optional("time_zero_s") or 0.0)


def _said_of_zero(options: Options) -> tuple[str, ...]:
    if options.optional("time_zero_s") is not None:
        return ()
    return (
        "the pulse is on the wall when the instrument's time is zero: "
        "neither the file nor --time-zero gives another time",
    )
