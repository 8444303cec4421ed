"""PicoQuant ``.phu``, ``.hhd``, ``.phd`` and ``.thd``: histograms, each a curve of the instrument."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError, UsageError
from rig.files.picoquant import MAGIC_HISTOGRAMS, Head
from rig.importers.content import Content
from rig.importers.options import Options
from rig.importers.source import Source
from rig.importers.visits import visits

NAME = "PicoQuant histograms"
SIGN = ".phu, .hhd, .phd or .thd whose curves are the points of a scan"
_OFFSET = "HistResDscr_MDescOffset"
PARTS = ("HistoResult_NumberOfCurves", "HistResDscr_DataOffset", "HistResDscr_HistogramBins")


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.head is not None and source.head.magic == MAGIC_HISTOGRAMS and source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the curves, one for each point of the plan.

    Raises
    ------
    UsageError
        If places are not known and were not given, or are not as many as the curves.
    DataFileError
        If the file has no whole curve, or its curves differ in their bins.
    """
    assert source.head is not None
    head = source.head
    offset, bins, width_s, told = _curves(head)
    plan = visits(head, options)
    if len(offset) > plan.points or (len(offset) < plan.points and not told):
        raise UsageError(
            f"{source.path} holds {len(offset):,} curves, but the plan has {plan.points:,} points; "
            "check --grid"
        )
    laser_m, detector_m, delay_s = plan.pairs(len(offset))
    begin_s, begin_told = _begin_s(head)
    return Content(
        laser_m=laser_m,
        detector_m=detector_m,
        bins=bins,
        bin_width_s=width_s,
        first_bin_s=plan.first_bin_s + begin_s,
        dtype=np.dtype("<u4"),
        blocks=_blocks(head, offset, bins),
        delay_s=delay_s,
        assumed=(*told, *begin_told, *plan.assumed),
    )


def _curves(head: Head) -> tuple[NDArray[np.int64], int, float, tuple[str, ...]]:
    """Return where each whole curve lies, number and width of their bins, and what is to be said."""
    curves = int(head.number("HistoResult_NumberOfCurves"))
    offset, bins, width_s = (
        head.numbers(f"HistResDscr_{name}") for name in ("DataOffset", "HistogramBins", "MDescResolution")
    )
    if not 0 < curves == len(offset) == len(bins) == len(width_s):
        raise DataFileError(
            f"{head.path} says that it holds {curves} curves, but describes {len(offset)}; it is damaged"
        )
    if len(np.unique(bins)) > 1 or len(np.unique(width_s)) > 1 or not bins[0] > 0 or not width_s[0] > 0:
        raise DataFileError(
            f"{head.path}: its curves differ in number or width of bins; they are not from one scan"
        )
    if head.number("HistoResult_BitsPerBin", 32) != 32:
        raise DataFileError(f"{head.path}: bins of other than 32 bits are not known")
    if (offset < head.end).any() or (np.diff(np.sort(offset)) < 4 * bins[0]).any():
        raise DataFileError(f"{head.path}: its curves overlap its header, or each other; it is damaged")
    missing = np.flatnonzero(offset + 4 * bins > head.size)
    told: tuple[str, ...] = ()
    if len(missing):
        whole = int(missing[0])
        told = (
            f"the file is cut off: {whole} of its {curves} curves are complete, "
            f"those before curve {whole + 1}",
        )
        if not whole:
            raise DataFileError(f"{head.path} is cut off: none of its {curves} curves is complete")
        offset = offset[:whole]
    return offset.astype(np.int64), int(bins[0]), float(width_s[0]), told


def _begin_s(head: Head) -> tuple[float, tuple[str, ...]]:
    """Return when after a sync pulse the first bin begins, and what is to be said."""
    late_ns = np.unique(head.numbers(_OFFSET)) if _OFFSET in head.values else np.zeros(1)
    if len(late_ns) > 1:
        raise DataFileError(f"{head.path}: its curves begin at different times; they are not from one scan")
    if not late_ns[0]:
        return 0.0, ()
    return late_ns[0] * 1e-9, (
        f"the first bin begins {late_ns[0]:g} ns after a sync pulse, as given in the file",
    )


def _blocks(head: Head, offset: NDArray[np.int64], bins: int) -> Iterator[NDArray[np.uint32]]:
    with head.path.open("rb") as file:
        for place in offset:
            file.seek(place)
            yield np.fromfile(file, "<u4", bins)[None]
