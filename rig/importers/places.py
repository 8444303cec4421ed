"""Positions without a place: NaN where a ray missed the wall, (0, 0, 0) where nothing was measured."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError
from rig.importers.content import Content

#: A lone point at zero is none of the others' wall where it is so many of their mean spacings away from them,
#: and there are so many others that they have one.
_APART, _OTHERS = 3.0, 8


def zeros_as_missing(*sides_m: NDArray[np.float64]) -> tuple[list[NDArray[np.float64]], list[str]]:
    """Return places with NaN where they were not measured, and what was done, in words.

    Programs that keep places in an array of fixed size leave (0, 0, 0) where they measured nothing. A spot at
    the origin may also be real, so rows at zero count as missing only where there are more of them than there
    are of any other row, as no scan visits one spot of its own, or where the only one lies apart from all
    others.

    Parameters
    ----------
    sides_m
        One array (n, 3) of points, or two whose rows belong together.
    """
    rows = np.hstack(sides_m)
    here = np.isfinite(rows).all(axis=1)
    zero = here & np.any([~side.any(axis=1) for side in sides_m], axis=0)
    missing = zero & (_repeated(rows, zero, here & ~zero) | _apart(rows, zero, here & ~zero))
    if not missing.any():
        return list(sides_m), []
    return [np.where(missing[:, None], np.nan, side) for side in sides_m], [
        f"{np.count_nonzero(missing)} of {len(rows)} places are (0, 0, 0), "
        "which usually means not measured: they are left out"
    ]


def _repeated(rows: NDArray, zero: NDArray, others: NDArray) -> NDArray[np.bool_]:
    """Return which rows at zero are there more often than any row elsewhere."""
    found = np.zeros(len(rows), bool)
    if not others.any() or not zero.any():
        return found
    often = np.unique(rows[others], axis=0, return_counts=True)[1].max()
    _, back, counts = np.unique(rows[zero], axis=0, return_inverse=True, return_counts=True)
    found[zero] = counts[back.ravel()] > often
    return found


def _apart(rows: NDArray, zero: NDArray, others: NDArray) -> NDArray[np.bool_]:
    """Return the only row at zero, if it is apart from all others."""
    count = np.count_nonzero(others)
    if np.count_nonzero(zero) != 1 or count < _OTHERS:
        return np.zeros(len(rows), bool)
    low, high = rows[others].min(axis=0), rows[others].max(axis=0)
    away = np.maximum(low - rows[zero][0], rows[zero][0] - high).max()
    return zero & bool(away > _APART * (high - low).max() / np.sqrt(count))


def paired(lit_m: NDArray, seen_m: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (P, 3) laser spots, and (P, 3) detector spots or the (1, 3) that is all of them.

    A position that lacks one of the two gets NaN as its laser spot.
    """
    missing = ~(np.isfinite(lit_m).all(axis=1) & np.isfinite(seen_m).all(axis=1))
    lit_m = np.where(missing[:, None], np.nan, lit_m)
    there_m = seen_m[~missing]
    return lit_m, there_m[:1] if len(there_m) and (there_m == there_m[0]).all() else seen_m


def with_places(content: Content, path: Path) -> Content:
    """Return the content without the positions that have no place, or no delay; it says how many they were.

    Raises
    ------
    DataFileError
        If none is left.
    """
    positions = len(content.laser_m)
    both_m = np.hstack([content.laser_m, np.broadcast_to(content.detector_m, content.laser_m.shape)])
    here: NDArray[np.bool_] = np.all(np.isfinite(both_m), axis=1)
    if content.delay_s is not None:
        here &= np.isfinite(content.delay_s)
    if here.all():
        return content
    lost = positions - np.count_nonzero(here)
    if lost == positions:
        raise DataFileError(
            f"{path}: none of its {positions} positions has a place: their laser or detector spots are "
            "not finite numbers (NaN); the rays missed the wall, or the places were not written"
        )
    told = (
        f"{lost} of {positions} positions have no place on the wall (NaN: a ray missed it, or nothing was "
        "measured) and are left out"
    )
    return replace(
        content,
        laser_m=content.laser_m[here],
        detector_m=content.detector_m if len(content.detector_m) == 1 else content.detector_m[here],
        delay_s=None if content.delay_s is None else content.delay_s[here],
        blocks=_kept(content.blocks, here),
        pixels=0,
        assumed=(*content.assumed, told),
    )


def _kept(blocks: Iterable[NDArray], here: NDArray) -> Iterator[NDArray]:
    start = 0
    for block in blocks:
        yield block[here[start : start + len(block)]]
        start += len(block)
