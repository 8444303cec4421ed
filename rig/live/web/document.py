"""What is known of a scan as a document for the page: words as they are read, and images in 255 steps.

The page only places what is here. What is said of the light is made in one place, so that it can be tested.
"""

import base64
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from math import isfinite
from typing import Any

import matplotlib
import numpy as np
from matplotlib.colors import Colormap, to_hex
from numpy.typing import NDArray

from recon.accumulate import Picture
from recon.capture import C_M_PER_S, Capture
from recon.grid import VoxelGrid
from rig.acquire.events import LightChanged, Noticed, Outcome
from rig.live.figure import COUNT_COLOURS, COUNTS_PERCENT
from rig.live.messages import Begun
from rig.live.state import Seen, Subject
from rig.live.wall import WallMap, squares_in_words
from rig.model.colours import DEPTH_COLOURS
from rig.model.quantities import show, show_duration, show_length
from rig.show.sheet import COLOURS
from rig.show.volume import depth_range

#: Steps of the tables of colours; values are stored in so many steps, 0 stands for nothing there.
_COLOURS, _LEVELS = 64, 255
#: Pixels of an image at most; of more, some are left out.
_MOST_PIXELS = 2**18


@dataclass(frozen=True)
class Beside:
    """What is known beside the state.

    Attributes
    ----------
    heard_s
        Seconds since 1970 at which the scan was heard of last.
    stop_asked_s
        When somebody asked on the page for a stop; None where nobody did.
    """

    heard_s: float
    stop_asked_s: float | None = None


class Document:
    """Makes documents of one scan.

    Parameters
    ----------
    begun
        What was known before its first photon.
    subject
        The same, as the live view needs it.
    """

    def __init__(self, begun: Begun, subject: Subject) -> None:
        self._begun, self._subject = begun, subject
        self._wall = WallMap.of(subject.laser_m, subject.rounds)
        self._picture: tuple[Picture | None, dict[str, Any] | None] = (None, None)
        self._scan = {
            "name": subject.name,
            "facts": _facts(begun, subject),
            "reads": begun.reads,
            "colours": {
                "counts": _table(matplotlib.colormaps[COUNT_COLOURS]),
                "amplitude": _table(matplotlib.colormaps[COLOURS]),
                "depth": _table(DEPTH_COLOURS),
            },
        }

    def of(self, seen: Seen, beside: Beside) -> dict[str, Any]:
        """Return all that is known at a moment."""
        over = seen.ended is not None or seen.lost
        return {
            "scan": self._scan,
            "utc_offset_s": _utc_offset_s(),
            "light": light(seen, reads=self._begun.reads),
            "phase": _phase(seen, "being written" if self._begun.reads else "beginning"),
            "progress": self._progress(seen),
            "numbers": self._numbers(seen),
            "newest_s": _finite(seen.newest_s),
            "heard_s": round(beside.heard_s, 1),
            "stop": {
                "possible": not self._begun.reads and not over,
                "asked": None if beside.stop_asked_s is None else _time_of_day(beside.stop_asked_s),
            },
            "wall": self._wall_of(seen),
            "picture": self._picture_of(seen),
            "histogram": self._histogram(seen),
            "rates": _rates(seen),
            "warnings": [_warning(one) for one in reversed(seen.warnings)],
            "end": self._end(seen),
        }

    def _progress(self, seen: Seen) -> dict[str, Any]:
        subject = self._subject
        if subject.endless:
            frames = seen.measured // subject.frame_steps
            return {"part": None, "words": f"{seen.measured:,} positions, {frames:,} frames until stopped"}
        part = seen.measured / subject.steps
        return {
            "part": round(part, 4),
            "words": f"{seen.measured:,} of {subject.steps:,} positions ({part:.0%})",
        }

    def _numbers(self, seen: Seen) -> list[tuple[str, str]]:
        """Return what is known in numbers, with labels."""
        told = [("photons", f"{seen.total:,}")]
        if len(seen.photons_per_s):
            told.append(("rate while exposing", show(float(seen.photons_per_s[-1]), "photons/s")))
        if seen.rates is not None:
            told.append(("before the first exposure", f"{show(seen.rates.input_hz, 'counts/s')}, sync "
                         f"{show(seen.rates.sync_hz, 'Hz')}"))  # fmt: skip
        if seen.ended is None and not seen.lost and seen.left_s is not None and seen.ends_s is not None:
            told.append(("time left", show_duration(round(seen.left_s))))
            told.append(("ends about", _time_of_day(seen.ends_s)))
        return told

    def _wall_of(self, seen: Seen) -> dict[str, Any]:
        image, side = self._wall.image(seen.photons)
        there = np.isfinite(seen.photons)
        low, high = 0.0, 1.0
        if there.any():
            low, high = np.percentile(seen.photons[there], COUNTS_PERCENT)
        cells = self._wall.cells
        said = f"{np.count_nonzero(there):,} positions measured"
        if there.any():
            said += f", 98 % of them with {low:.0f} to {high:.0f} photons"
        drawn = _image(image, cells.x.coordinates_m, cells.y.coordinates_m, low, max(high, low + 1))
        return {**drawn, "note": squares_in_words(side), "said": said}

    def _picture_of(self, seen: Seen) -> dict[str, Any] | None:
        """Return the live image; it is made once of each picture."""
        if seen.picture is None:
            return None
        if seen.picture is not self._picture[0]:
            self._picture = seen.picture, _picture(seen.picture, self._subject.capture)
        made = self._picture[1]
        assert made is not None
        return {**made, "title": seen.title}

    def _histogram(self, seen: Seen) -> dict[str, Any] | None:
        filled = np.flatnonzero(seen.histogram)
        if not len(filled):
            return None
        first, last = int(filled[0]), int(filled[-1])
        edges_ns = seen.histogram_edges_s * 1e9
        return {
            "first_ns": round(float(edges_ns[first]), 4),
            "width_ns": round(float(edges_ns[1] - edges_ns[0]), 6),
            "photons": seen.histogram[first : last + 1].tolist(),
            "gate": [
                {"name": name, "ns": [round(edge_s * 1e9, 3) for edge_s in edge]}
                for name, edge in zip(("gate opens", "gate closes"), self._subject.gate_s, strict=False)
            ],
        }

    def _end(self, seen: Seen) -> dict[str, Any] | None:
        if seen.lost:
            return {"how": "lost", "words": "The scanning program has ended without giving a reason.",
                    "next": self._begun.then.resume}  # fmt: skip
        if seen.ended is None:
            return None
        complete = seen.ended.outcome is Outcome.COMPLETE
        return {
            "how": seen.ended.outcome.value,
            "words": f"{seen.ended.outcome.value.capitalize()} after {seen.ended.steps_done:,} positions: "
            f"{seen.ended.reason}",
            "next": self._begun.then.recon if complete else self._begun.then.resume,
        }


def light(seen: Seen, *, reads: bool) -> dict[str, str]:
    """Say what is known of the laser's light.

    Parameters
    ----------
    seen
        What is known of the scan.
    reads
        Whether that comes from a scan file rather than from the program that scans.

    Returns
    -------
    ``is``: ``on``, ``dark``, ``unknown`` or ``unsaid``; ``words``; ``from``: where this is known from;
    ``last``: the words for when nothing is heard any more.
    """
    said = _light_said(seen.light)
    told = said["words"]
    source = "the last entry in the log of the scan file" if reads else "as the laser was read back"
    if (seen.lost or seen.ended is not None) and said["is"] == "on":
        why = "the scanning program has ended" if seen.lost else "darkness was not confirmed"
        words = f"LIGHT NOT KNOWN, {why}: treat the laser as EMITTING"
        return {"is": "unknown", "words": words, "from": f"last report: {told}", "last": told}
    return {**said, "from": source if seen.light else "", "last": told}


def _light_said(last: LightChanged | None) -> dict[str, str]:
    if last is None:
        return {"is": "unsaid", "words": "the state of the laser's light is not known yet"}
    when = last.when[11:19]
    if last.on is None:
        return {
            "is": "unknown",
            "words": f"THE LASER CANNOT BE CONFIRMED DARK ({when}): treat it as EMITTING, turn its key off",
        }
    if last.on:
        return {"is": "on", "words": f"LASER ON since {when}"}
    return {"is": "dark", "words": f"laser dark, {last.how} at {when}"}


def _facts(begun: Begun, subject: Subject) -> list[tuple[str, str]]:
    state = begun.description.state
    orders = {"snake": "raster", "list": "a list of spots"}
    told = {
        **(state.config.notes.said() if state else {}),
        "rig": subject.rig,
        "exposure": f"{show(subject.exposure_s, 's')} a position",
        "order": orders.get(subject.order, subject.order)
        + (", the mirror never stops" if subject.motion == "continuous" else ""),
        "frames": f"{subject.frames:,}" if subject.frames > 1 and not subject.endless else "",
        "channels": str(subject.channels) if subject.channels > 1 else "",
    }
    return [(name, text) for name, text in told.items() if text]


def _phase(seen: Seen, otherwise: str) -> str:
    if seen.lost:
        return "gone"
    return seen.ended.outcome.value if seen.ended else seen.phase or otherwise


def _warning(one: Noticed) -> dict[str, str]:
    where = f"position {one.first:,}" if one.first == one.last else f"positions {one.first:,} to {one.last:,}"
    return {
        "when": _time_of_day(one.when_s) if isfinite(one.when_s) else "",
        "kind": one.kind,
        "where": where,
        "sentence": one.sentence,
    }


def _rates(seen: Seen) -> dict[str, Any] | None:
    if not len(seen.moments_s):
        return None
    return {
        "s": np.round(seen.moments_s, 2).tolist(),
        "photons_per_s": np.rint(seen.photons_per_s).astype(int).tolist(),
    }


def _picture(picture: Picture, capture: Capture) -> dict[str, Any]:
    grid, surface = picture.grid, picture.surface
    largest = float(picture.front.max())
    front = picture.front / largest if largest > 0 else picture.front
    found = np.isfinite(surface.depth_m)
    low, high = depth_range(surface.depth_m[found] if found.any() else grid.z_m)
    seen = f"A surface is seen in {found.mean():.0%} of it" if found.any() else "No surface is seen in it"
    if surface.empty:
        seen = "No signal above noise"
    return {
        "wavelength": show_length(picture.pulse.wavelength_m),
        "front": _image(front, grid.x_m, grid.y_m, 0.0, 1.0),
        "depth": _image(surface.depth_m, grid.x_m, grid.y_m, low, high),
        "empty": bool(surface.empty),
        "said": seen + (f", {low:.2f} to {high:.2f} m deep." if found.any() else "."),
        "imaged_ns": [round(time_s * 1e9, 3) for time_s in imaged_s(capture, grid)],
    }


def imaged_s(capture: Capture, grid: VoxelGrid) -> tuple[float, float]:
    """Return the earliest and the latest rectified time of light from any voxel of a grid.

    Light goes from a laser spot to a voxel and to a detector spot. The sum of the two ways is a convex
    function of the voxel: it is longest at one of the corners. The shortest is bounded from below by the
    shortest of each way.
    """
    axes = (grid.x_m, grid.y_m, grid.z_m)
    low_m, high_m = (np.array([end(axis) for axis in axes]) for end in (np.min, np.max))
    corners_m = np.stack(np.meshgrid(*zip(low_m, high_m, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    shortest_m, longest_m = 0.0, np.zeros(len(corners_m))
    for spots_m in (capture.laser_m, capture.detector_m):
        spots_m = np.reshape(spots_m, (-1, 3))
        nearest_m = np.linalg.norm(np.clip(spots_m, low_m, high_m) - spots_m, axis=1)
        shortest_m += float(nearest_m.min())
        longest_m += np.array([np.linalg.norm(spots_m - one, axis=1).max() for one in corners_m])
    return shortest_m / C_M_PER_S, float(longest_m.max()) / C_M_PER_S


def _image(
    values: NDArray[np.floating], x_m: NDArray, y_m: NDArray, low: float, high: float
) -> dict[str, Any]:
    """Return a (y, x) image, both ascending, in steps from ``low`` to ``high``; 0 where there is none."""
    every = 1
    while values.size > _MOST_PIXELS * every**2:
        every += 1
    values, x_m, y_m = values[::every, ::every], x_m[::every], y_m[::every]
    part = np.clip((np.nan_to_num(values, nan=low) - low) / (high - low), 0, 1)
    levels = np.where(np.isfinite(values), 1 + np.rint(part * (_LEVELS - 1)), 0).astype(np.uint8)
    return {
        "x": _axis(x_m),
        "y": _axis(y_m),
        "low": float(low),
        "high": float(high),
        "levels": base64.b64encode(levels.tobytes()).decode("ascii"),
    }


def _axis(axis_m: NDArray[np.float64]) -> dict[str, float]:
    pitch_m = float(axis_m[1] - axis_m[0]) if len(axis_m) > 1 else 0.01
    return {"first_m": round(float(axis_m[0]), 5), "pitch_m": round(pitch_m, 6), "count": len(axis_m)}


def _table(colours: Colormap) -> str:
    return "".join(to_hex(colour)[1:] for colour in colours(np.linspace(0, 1, _COLOURS)))


def _finite(value: float) -> float | None:
    return round(value, 2) if isfinite(value) else None


def _time_of_day(when_s: float) -> str:
    return datetime.fromtimestamp(when_s).strftime("%H:%M:%S")


def _utc_offset_s() -> int:
    offset = datetime.now().astimezone().utcoffset()
    return int(offset.total_seconds()) if offset else 0


#: Makes a document of what is known now.
Making = Callable[[], dict[str, Any]]
