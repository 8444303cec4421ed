"""A web page that shows a volume in three dimensions: one file, which needs neither server nor internet.

The browser draws it with WebGL 2, by the program in `web/`. The page holds the amplitude as pictures show
it, its fall-off with depth undone, in 256 steps from 0 to the maximum, and the depth map in 65 535 steps.
"""

import base64
import gzip
import html
import io
import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.colors import to_hex
from numpy.typing import NDArray
from PIL import Image

from recon.depth import compensate_falloff
from recon.result import Image as Reconstruction
from rig.atomic import appearing, refusals_told
from rig.errors import UsageError
from rig.exporters.arrays import pitches_m
from rig.files import Volume
from rig.files.words import caption, parameters_line
from rig.model.colours import AMPLITUDE_COLOURS, DEPTH_COLOURS

NAME = "web page"
ENDINGS = (".html", ".htm")
#: A browser holds so many voxels with ease; of more, neighbours are put together.
MOST_VOXELS = 2**23
#: Where nothing tells surfaces from noise, the page begins with this part of the maximum as its threshold.
THRESHOLD = 0.25
#: The page shows at first this much before and behind what is seen [m].
MARGIN_M = 0.2
#: Steps of the tables of colours, and of the depths that are stored; 0 stands for no surface.
_COLOURS, _DEPTHS = 128, 65535
_WEB = files("rig.exporters") / "web"


def save(volume: Volume, path: Path) -> None:
    """Write the page, whole or not at all; raises as `write`, and DataFileError if the disk refuses."""
    with refusals_told(path, "the page "), appearing(path) as partial:
        write(partial, volume)


def write(path: Path, volume: Volume) -> None:
    """Write the page.

    Raises
    ------
    UsageError
        If the volume has a time axis, or is not evenly spaced.
    """
    if volume.t_s is not None:
        raise UsageError(
            "a volume with a time axis is a film and has no page; image without --camera transient"
        )
    pitches = pitches_m(volume)
    amplitude = shown_amplitude(volume)
    smaller, factor = pooled(amplitude)
    levels = np.rint(smaller * 255).astype(np.uint8)
    axes_m = [
        _pooled_axis(axis, n, by, pitch)
        for axis, n, by, pitch in zip(
            (volume.x_m, volume.y_m, volume.z_m), levels.shape[::-1], factor[::-1], pitches, strict=True
        )
    ]
    depths_m, depth_levels = _depths(volume, factor)
    facts = _facts(volume, axes_m, amplitude) | {"depths_m": depths_m}
    facts["brightest"] = [int(at) for at in np.unravel_index(levels.argmax(), levels.shape)[::-1]]
    texts = {
        "TITLE": html.escape(volume.scan or "volume"),
        "HOW": html.escape(parameters_line(volume)),
        "SEEN": html.escape(seen_in_words(volume, amplitude)),
        "CAPTION": html.escape(caption(volume)),
        "STORED": html.escape(_stored(volume, levels, factor)),
        "FACTS": json.dumps(facts).replace("<", "\\u003c"),
        "VOXELS": _packed(levels.tobytes()),
        "SURFACE": _packed(b"" if depth_levels is None else depth_levels.astype("<u2").tobytes()),
        "PICTURE": _front_png(levels),
    }
    texts |= {
        name: _asset(file)
        for name, file in (
            ("STYLE", "page.css"),
            ("SCRIPT", "page.js"),
            ("VERTEX", "vertex.glsl"),
            ("FRAGMENT", "fragment.glsl"),
        )
    }
    # split, not replaced one after the other: what is filled in may hold such marks itself
    pieces = _asset("page.html").split("@")
    path.write_text("".join(texts.get(piece, piece) for piece in pieces), encoding="utf-8")


def _asset(name: str) -> str:
    return (_WEB / name).read_text(encoding="utf-8")


def shown_amplitude(volume: Volume) -> NDArray[np.float32]:
    """Return the (z, y, x) amplitude as pictures show it, the fall-off with depth undone, maximum 1."""
    amplitude = np.sqrt(np.maximum(np.nan_to_num(volume.intensity), 0))
    if volume.parameters.get("camera") != "photo":
        power = float(volume.parameters.get("falloff_power", Reconstruction.falloff_power))
        amplitude = compensate_falloff(amplitude, volume.z_m, power / 2)
    largest = amplitude.max()
    return amplitude / largest if largest > 0 else amplitude


def pooled(
    values: NDArray[np.float32], most: int = MOST_VOXELS
) -> tuple[NDArray[np.float32], tuple[int, ...]]:
    """Return values of which neighbours are put together, by their maximum, until they are few enough.

    Parameters
    ----------
    values
        (z, y, x).
    most
        Voxels at most.

    Returns
    -------
    The values, and how many became one along each axis; an axis is cut in halves while it is the longest.
    """
    factor = [1, 1, 1]
    while values.size > most:
        axis = int(np.argmax(values.shape))
        starts = np.arange(0, values.shape[axis], 2)
        values = np.maximum.reduceat(values, starts, axis=axis)
        factor[axis] *= 2
    return values, tuple(factor)


def _pooled_axis(axis_m: NDArray[np.float64], count: int, by: int, pitch_m: float) -> dict[str, float]:
    """Return the first centre, pitch and number of voxels of an axis, `by` put together."""
    return {"first_m": float(axis_m[0]) + (by - 1) * pitch_m / 2, "pitch_m": by * pitch_m, "count": count}


def _depths(volume: Volume, factor: tuple[int, ...]) -> tuple[list[float], NDArray[np.integer] | None]:
    """Return the ends of the colours of depth, and the (y, x) depth map in steps between; 0: no surface."""
    ends_m = [float(volume.z_m[0]), float(volume.z_m[-1])]
    if volume.depth_m is None:
        return _apart(ends_m), None
    depth_m = volume.depth_m[:: factor[1], :: factor[2]]
    found = np.isfinite(depth_m)
    if not found.any():
        return _apart(ends_m), np.zeros(depth_m.shape, np.uint16)
    ends_m = _apart([float(depth_m[found].min()), float(depth_m[found].max())])
    part = np.where(found, (depth_m - ends_m[0]) / (ends_m[1] - ends_m[0]), 0)
    return ends_m, np.where(found, 1 + np.rint(part * (_DEPTHS - 1)), 0).astype(np.uint16)


def _apart(ends_m: list[float], least_m: float = 0.1) -> list[float]:
    """Keep the ends of a range of depths apart, so that voxels' steps do not look like relief."""
    missing_m = max(0.0, least_m - (ends_m[1] - ends_m[0])) / 2
    return [ends_m[0] - missing_m, ends_m[1] + missing_m]


def _facts(volume: Volume, axes_m: list[dict[str, float]], amplitude: NDArray) -> dict[str, Any]:
    wall_m = volume.parameters.get("origin", {}).get("wall_m")
    bounds_m = [float(end) for axis in (volume.x_m, volume.y_m) for end in (axis[0], axis[-1])]
    tables = {"depth": DEPTH_COLOURS, "amplitude": matplotlib.colormaps[AMPLITUDE_COLOURS]}
    tables["grey"] = matplotlib.colors.LinearSegmentedColormap.from_list("grey", ["0.1", "0.8"])
    return {
        **dict(zip("xyz", axes_m, strict=True)),
        "wall_m": wall_m or bounds_m,
        "wall_known": wall_m is not None,
        "signal": bool(volume.parameters.get("signal", True)),
        "threshold": _threshold(volume, amplitude),
        "shown_m": _shown_depths(volume),
        "colours": {
            name: "".join(to_hex(colour)[1:] for colour in table(np.linspace(0, 1, _COLOURS)))
            for name, table in tables.items()
        },
    }


def _threshold(volume: Volume, amplitude: NDArray) -> float:
    """Return a threshold that shows most of what the depth map shows."""
    seen = None if volume.depth_m is None else np.isfinite(volume.depth_m)
    if seen is None or not seen.any():
        return THRESHOLD
    return round(float(np.clip(np.percentile(amplitude.max(axis=0)[seen], 10), 0.05, 0.6)), 2)


def _shown_depths(volume: Volume) -> list[float]:
    """Return the depths that are shown at first: where a surface is seen and a bit beside it, or all."""
    half_m = (volume.z_m[-1] - volume.z_m[0]) / max(1, len(volume.z_m) - 1) / 2
    ends_m = np.array([volume.z_m[0] - half_m, volume.z_m[-1] + half_m])
    if volume.depth_m is None or not np.isfinite(volume.depth_m).any():
        return ends_m.tolist()
    seen_m = np.array([np.nanmin(volume.depth_m) - MARGIN_M, np.nanmax(volume.depth_m) + MARGIN_M])
    return np.clip(seen_m, *ends_m).tolist()


def seen_in_words(volume: Volume, amplitude: NDArray) -> str:
    """Say what the picture shows, for those who do not see it."""
    z, y, x = np.unravel_index(int(amplitude.argmax()), amplitude.shape)
    sides = " x ".join(f"{np.ptp(axis):.2f} m" for axis in (volume.x_m, volume.y_m, volume.z_m))
    told = (
        f"Volume of {sides} (x, y, depth). Brightest at x {volume.x_m[x]:.2f} m, y {volume.y_m[y]:.2f} m, "
        f"depth {volume.z_m[z]:.2f} m."
    )
    if not volume.parameters.get("signal", True):
        return f"{told} No signal above noise."
    if volume.depth_m is None or not (seen := np.isfinite(volume.depth_m)).any():
        return told
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    x_m, y_m, z_m = volume.x_m[columns], volume.y_m[rows], volume.depth_m[seen]
    return (
        f"{told} A surface is seen in {seen.mean():.0%} of the front view, at x {x_m[0]:.2f} to "
        f"{x_m[-1]:.2f} m, y {y_m[0]:.2f} to {y_m[-1]:.2f} m and depths of {z_m.min():.2f} to "
        f"{z_m.max():.2f} m."
    )


def _stored(volume: Volume, levels: NDArray, factor: tuple[int, ...]) -> str:
    nz, ny, nx = levels.shape
    lifted = "" if volume.parameters.get("camera") == "photo" else ", its fall-off with depth compensated"
    told = (
        f"This page holds {nx} x {ny} x {nz} voxels: the amplitude{lifted}, in 256 steps up to its maximum."
    )
    if max(factor) > 1:
        z, y, x = factor
        told += (
            f" {x} x {y} x {z} voxels of the volume file are shown as one, with the brightest value of them."
        )
    return told


def _packed(values: bytes) -> str:
    """Return bytes as text: packed by gzip, in base 64."""
    return base64.b64encode(gzip.compress(values, 9, mtime=0)).decode("ascii")


def _front_png(levels: NDArray[np.uint8]) -> str:
    """Return the front view as a picture, for browsers without JavaScript."""
    colours = matplotlib.colormaps[AMPLITUDE_COLOURS](levels.max(axis=0)[::-1, ::-1], bytes=True)
    with io.BytesIO() as memory:
        Image.fromarray(colours[..., :3]).save(memory, "PNG", optimize=True)
        return base64.b64encode(memory.getvalue()).decode("ascii")
