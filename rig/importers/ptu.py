"""PicoQuant ``.ptu``, ``.ht2``, ``.ht3``, ``.pt2``, ``.pt3``: records whose markers tell a scan's points."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError, UsageError
from rig.files.picoquant import MAGIC_RECORDS, POINT_MARKER
from rig.importers.content import Content
from rig.importers.options import Options
from rig.importers.source import Source
from rig.importers.sweeps import Sweeps
from rig.importers.visits import Visits, visits

if TYPE_CHECKING:
    from rig.importers.tagged import Records, Survey

NAME = "PicoQuant records"
SIGN = (
    ".ptu, .ht2, .ht3, .pt2 or .pt3 with records (T2 or T3) of a HydraHarp, a similar instrument, "
    "or a PicoHarp 300"
)
PARTS = ("TTResultFormat_TTTRRecType", "TTResult_NumberOfRecords")

#: A gap between markers of so many usual ones lacks some.
_GAP = 1.5


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.head is not None and source.head.magic == MAGIC_RECORDS and source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the records: each point's photons become its transient.

    Raises
    ------
    UsageError
        If places, markers or bins are not known and were not given, or do not fit the file.
    DataFileError
        If the records are of another kind, damaged, or lack what a scan needs.
    """
    from rig.importers.tagged import MOST_BINS, Records, Survey, blocks  # compiled kernels: not for all files

    assert source.head is not None
    records = Records.of(source.head)
    width_s = _bin_width_s(records, options)
    seen = Survey.of(records, width_s)
    if not seen.photons or not len(seen.mask):
        raise DataFileError(
            f"{source.path} is not a scan: it holds {seen.in_words()}. Without "
            f"{'photons' if len(seen.mask) else 'markers'} it is not known which photons belong to "
            "which point"
        )
    plan = visits(source.head, options)
    inputs = _inputs(seen, plan, options, source.path)
    sweeps = Sweeps.of(source.head, plan.points)
    if sweeps is not None:
        start, stop, told = sweeps.points(seen, records)
    else:
        start, stop, told = _points(seen, records, plan, Marks.of(plan, options, seen, source.path))
    low, high = _range(seen, plan, inputs, MOST_BINS)
    laser_m, detector_m, delay_s = plan.pairs(len(start))
    outside = seen.photons - int((stop - start).sum())
    if seen.timeless:
        told.append(f"{seen.timeless:,} photons have no sync pulse shortly before them, and are left out")
    if outside:
        told.append(f"{outside:,} of {seen.photons:,} photons lie before or between points, and are left out")
    return Content(
        laser_m=laser_m,
        detector_m=detector_m,
        bins=high - low,
        bin_width_s=width_s,
        first_bin_s=plan.first_bin_s + low * width_s,
        dtype=np.dtype("<u4"),
        blocks=blocks(records, width_s, inputs, range(low, high), (start, stop)),
        fade_from_s=plan.fade_from_s,
        delay_s=delay_s,
        assumed=(*records.told, *told, *plan.assumed),
    )


def _bin_width_s(records: "Records", options: Options) -> float:
    """Return the width of a bin: of the instrument in T3, of a person's choice in T2."""
    if records.format.is_t3:
        width_s = float(records.head.number("MeasDesc_Resolution"))
    else:
        width_s = float(
            options.asked("bin_width_s", records.head.path, "how wide bins must be", "T2 records have none")
        )
        unit_s = float(records.head.number("MeasDesc_GlobalResolution"))
        if not 1e-15 < unit_s < 1:
            raise DataFileError(
                f"{records.head.path}: its times count {unit_s:g} s, which is impossible for an instrument"
            )
        width_s = max(1, round(width_s / unit_s)) * unit_s
    if not 1e-15 < width_s < 1:
        raise DataFileError(
            f"{records.head.path}: bins of {width_s:g} s are impossible for a photon counter; it is damaged"
        )
    return width_s


def _inputs(seen: "Survey", plan: Visits, options: Options, path: object) -> tuple[int, ...]:
    """Return which inputs are the scan's channels, in the order of its channels."""
    if plan.inputs is not None:
        return plan.inputs
    counting = np.flatnonzero(seen.counts)
    wanted = options.optional("input")
    if wanted is None and len(counting) == 1:
        return (int(counting[0]),)
    wanted = options.asked("input", path, f"which input is imaged: it holds {seen.in_words()}")
    if wanted not in counting:
        raise UsageError(f"--input {wanted}: {path} holds {seen.in_words()}")
    return (int(wanted),)


def _range(seen: "Survey", plan: Visits, inputs: tuple[int, ...], most: int) -> tuple[int, int]:
    """Return the first bin, and the one after the last."""
    if plan.bins is not None and 0 < plan.bins <= most:
        return 0, plan.bins
    low, high = int(seen.lowest[list(inputs)].min()), int(seen.highest[list(inputs)].max()) + 1
    if low >= high:
        raise DataFileError(
            "the input's photons have no time after a sync pulse: T2 needs recorded sync pulses"
        )
    return low, high


@dataclass(frozen=True)
class Marks:
    """Which markers begin a point and a line, counted from 1.

    Attributes
    ----------
    point, line
        The line's is None where there is none.
    """

    point: int
    line: int | None

    @classmethod
    def of(cls, plan: Visits, options: Options, seen: "Survey", path: object) -> Self:
        """Take what was given, unless the file is this program's.

        Raises
        ------
        UsageError
            If it is not known which marker begins a point, or both are the same.
        """
        if plan.inputs is not None:
            return cls(POINT_MARKER, None)
        what = f"which marker begins a point: it holds {seen.in_words()}"
        point, line = options.asked("point_marker", path, what), options.optional("line_marker")
        for name, number in (("--point-marker", point), ("--line-marker", line)):
            if number is not None and number not in {1, 2, 3, 4}:
                raise UsageError(f"{name} {number}: markers are 1 to 4")
        if point == line:
            raise UsageError(
                f"--line-marker {line} and --point-marker {point} are the same; "
                "give another one for lines, or leave it out"
            )
        return cls(point, line)


def _points(
    seen: "Survey", records: "Records", plan: Visits, marks: Marks
) -> tuple[NDArray, NDArray, list[str]]:
    """Return where each point's photons begin and end, and what is to be said.

    A point begins at its marker and ends at the next one, of a point or a line; the last ends with the
    records.

    Raises
    ------
    DataFileError
        If there are fewer markers than the plan has points.
    UsageError
        If there are more, or no such markers.
    """
    path = records.head.path
    told = [f"{seen.unknown:,} records have an unknown kind, and were skipped"] if seen.unknown else []
    is_point = seen.mask & 1 << marks.point - 1 != 0
    is_line = marked = np.zeros_like(is_point)
    if marks.line is not None:
        is_line = marked = seen.mask & 1 << marks.line - 1 != 0
        if (is_line & is_point).any():  # a line begins with a point; alone the marker ends it
            is_line = is_line & is_point
        _check_lines(seen, is_point, is_line, plan, records)
        told.append(
            f"{np.count_nonzero(is_line):,} lines begin at markers, as set by --line-marker {marks.line}"
        )
    edges = is_point | marked
    ends = np.append(seen.photon[edges][1:], seen.photons)[is_point[edges]]
    begins, tags = seen.photon[is_point], seen.tag[is_point]
    if records.truncated and len(begins) and len(begins) <= plan.points:
        whole = len(begins) - 1
        where = plan.place(whole)
        told.append(
            f"the last complete one of {plan.points:,} points is the one before {where}; the rest is missing"
        )
        begins, ends = begins[:whole], ends[:whole]
        if not whole:
            raise DataFileError(f"{path} is cut off within its first point: it holds no complete point")
    elif len(begins) != plan.points:
        said = (
            f"{path} holds {len(begins):,} markers of points (--point-marker {marks.point}), but the plan "
            f"has {plan.points:,} points"
        )
        frames = len(begins) // plan.points
        if frames > 1 and frames * plan.points == len(begins):
            raise UsageError(f"{said}: it holds {frames} frames of --grid, and only one can be read")
        if len(begins) < 3 or len(begins) > plan.points:
            raise UsageError(f"{said}; check --grid, --point-marker, and the marker's hold-off time")
        raise DataFileError(f"{said}. {_gap(tags, plan)}")
    return begins, ends, told


def _check_lines(
    seen: "Survey", is_point: NDArray, is_line: NDArray, plan: Visits, records: "Records"
) -> None:
    """Raise an error that names line and point unless each line has its points."""
    columns, path = plan.columns, records.head.path
    if columns is None:
        return
    line_of_point = np.cumsum(is_line)[is_point] - 1
    lines, rows = int(np.count_nonzero(is_line)), plan.points // columns
    in_line = np.bincount(line_of_point[line_of_point >= 0], minlength=lines)
    checked = in_line[:-1] if records.truncated else in_line
    for line in np.flatnonzero(checked != columns)[:1]:
        gaps = np.append(np.diff(seen.tag[is_point][line_of_point == line]), 0)
        late = np.flatnonzero(gaps > _GAP * np.median(gaps))
        after = f" After point {late[0] + 1} of it there is a gap." if len(late) else ""
        raise DataFileError(
            f"{path}: line {line + 1} has {in_line[line]} markers of points of {columns}.{after} Its "
            "photons cannot be assigned to points; check --point-marker, --line-marker and --grid"
        )
    if not records.truncated and lines != rows:
        raise UsageError(
            f"{path} holds {lines} markers of lines (--line-marker), but the plan has {rows} lines"
        )


def _gap(tags: NDArray[np.int64], plan: Visits) -> str:
    """Say where a marker seems to be missing."""
    gaps = np.diff(tags)
    late = np.flatnonzero(gaps > _GAP * np.median(gaps))
    if not len(late):
        return "They follow one another evenly, so that the first or the last are missing; check --grid"
    return f"The first gap is after {plan.place(int(late[0]))}, where one seems to be missing"
