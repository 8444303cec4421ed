"""What was given held against what the file says: agreed with, or refused; never without effect unseen."""

from dataclasses import replace
from math import isclose
from pathlib import Path
from typing import Any

import numpy as np

from rig.errors import UsageError
from rig.importers.content import Content
from rig.importers.options import OF_PLAN, SPELLING, Options
from rig.model.quantities import show, show_length

#: A given number says the same as the file's where they differ by no more than this part: rounding alone.
_SAME = 1e-6


def hold_against(content: Content, options: Options, path: Path, layout: str) -> Content:
    """Return the content with what was given worked in and told of.

    Where the wall's own light ends may be given for any file. All else that no importer took is compared with
    what the file says.

    Raises
    ------
    UsageError
        If something given contradicts the file, or can have no effect on it.
    """
    content = _faded(content, options.optional("fade_from_s"), path)
    agreed = []
    for name, given in options.not_taken().items():
        said, agrees = _said(name, given, content)
        if not agrees:
            raise UsageError(
                f"{SPELLING[name]} {_shown(name, given)} contradicts {path} ({layout}): {said}. "
                f"Leave {SPELLING[name]} out"
            )
        agreed.append(f"{SPELLING[name]} {_shown(name, given)} agrees with the file")
    return replace(content, assumed=(*content.assumed, *agreed))


def _faded(content: Content, given_s: float | None, path: Path) -> Content:
    last_s = content.first_bin_s + content.bins * content.bin_width_s - least_delay_s(content)
    if given_s is None:
        if content.fade_from_s is None or content.fade_from_s < last_s:
            return content
        told = (
            f"all of the record is faded out: it ends at {show(last_s, 's')}, "
            f"and the light of the wall itself at {show(content.fade_from_s, 's')}; check --bin-width, "
            "or give --fade-from"
        )
        return replace(content, assumed=(*content.assumed, told))
    if not 0 <= given_s < last_s:
        raise UsageError(
            f"--fade-from {show(given_s, 's')} would fade out all of {path}: its record ends at "
            f"{show(last_s, 's')}; give a time within it"
        )
    told = f"what comes before {show(given_s, 's', 4)} is faded out, as set by --fade-from"
    if content.fade_from_s is not None and not isclose(content.fade_from_s, given_s, rel_tol=_SAME):
        told += (
            f", not what comes before {show(content.fade_from_s, 's', 4)}, as set by the file or its layout"
        )
    return replace(content, fade_from_s=given_s, assumed=(*content.assumed, told))


def least_delay_s(content: Content) -> float:
    """Return the least that is subtracted from a position's time; 0 where nothing is."""
    delay_s = np.zeros(1)
    if content.delay_s is not None:
        delay_s = content.delay_s
    elif content.delays is not None:
        delay_s = content.delays.delay_s(content.laser_m, content.detector_m)
    known_s = delay_s[np.isfinite(delay_s)]
    return float(known_s.min()) if known_s.size else 0.0


def _said(name: str, given: Any, content: Content) -> tuple[str, bool]:
    """Return what the file says where an option might have been used, and whether that is what was given."""
    if name == "bin_width_s":
        width_s = content.bin_width_s
        return f"its bins are {show(width_s, 's', 7)} wide", isclose(given, width_s, rel_tol=_SAME)
    if name == "time_origin":
        origins = {
            "wall": "its time is rectified (wall)",
            "laser": "its time includes the paths to and from the wall (laser)",
        }
        return origins[content.time_origin], given == content.time_origin
    if name in {"wall_size_m", "depth_pitch_m"}:
        spots_m = np.concatenate([content.laser_m, content.detector_m])
        span_m = np.ptp(spots_m, axis=0)
        across_m, deep_m = float(span_m[:2].max()), float(span_m[2])
        if name == "wall_size_m":
            said = f"the places of its spots are known, and they span {show_length(across_m, 7)}"
            return said, isclose(given, across_m, rel_tol=_SAME)
        return f"the places of its spots are known, and their depths differ by {show_length(deep_m)}", False
    if name in OF_PLAN:
        return "it holds the places of its spots, or a grid of them", False
    if name == "time_zero_s":
        return "it contains what its time zero is", False
    if name == "bounces":
        return "it does not separate bounces", False
    if content.time_origin == "wall":
        return "its time is rectified, and no flight to the wall is left in it", False
    return "the flight to the wall is known from the file itself", False


def _shown(name: str, given: Any) -> str:
    if name in {"bin_width_s", "time_zero_s"}:
        return show(given, "s", 7)
    if name in {"wall_size_m", "depth_pitch_m", "spacing_m"}:
        return show_length(given, 7)
    between = {"bounces": ",", "grid": "x"}.get(name)
    return str(given) if between is None else between.join(map(str, given))
