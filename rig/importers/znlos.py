"""Zaragoza's Z-NLOS data set: HDF5 with ``data`` of five or seven axes.

``data`` (colour, t, bounce, sx, sy), confocal, or (colour, t, bounce, sx, sy, lx, ly), each laser point with
each sensor point; or all axes reversed, as a program that counts them the other way has written them.
``cameraGridPositions`` (3, sx, sy), ``laserGridPositions`` (3, lx, ly), ``cameraPosition``,
``laserPosition``, and normals, in metres; ``deltaT`` bin width and ``t0`` start, metres of optical path. The
time includes the legs from the laser to the wall and from the wall to the camera.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from rig.errors import DataFileError, UsageError
from rig.files.blocks import read as read_part
from rig.files.blocks import spans
from rig.files.check import reading
from rig.importers.content import Content
from rig.importers.options import Options
from rig.importers.pairs import each_with_each
from rig.importers.places import zeros_as_missing
from rig.importers.source import Source
from rig.importers.wall import WallFrame, named

NAME = "Zaragoza Z-NLOS"
SIGN = (
    "HDF5 with data (colour, t, bounce, sx, sy[, lx, ly]), cameraGridPositions, laserGridPositions and deltaT"
)
PARTS = ("data", "cameraGridPositions", "laserGridPositions", "deltaT")
_BLOCK_BYTES = 2**26


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return not source.matlab5 and source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the file, block by block; colours and the chosen bounces are added up.

    Raises
    ------
    UsageError
        If a bounce was asked for that the file does not have.
    DataFileError
        If arrays do not fit together.
    """
    shape = source.shapes["data"] or ()
    reversed_ = _is_reversed(source, shape)
    ordered = shape[::-1] if reversed_ else shape
    (camera_m,), unmeasured = zeros_as_missing(_points(source, "cameraGridPositions", reversed_))
    (laser_m,), unlit = zeros_as_missing(_points(source, "laserGridPositions", reversed_))
    bounces = _bounces(source, ordered[2], options.optional("bounces"))
    delta_m, start_m = (source.numbers(name, 1)[0] for name in ("deltaT", "t0"))
    if not delta_m > 0:
        raise DataFileError(f"{source.path}: deltaT is {delta_m} m; it must be positive")
    camera_head_m, laser_head_m = (source.numbers(f"{side}Position", 3) for side in ("camera", "laser"))
    normals = None
    if source.has("cameraGridNormals"):
        normals = _points(source, "cameraGridNormals", reversed_)
    with named(source.path):
        frame = WallFrame.of(camera_m, normals, camera_head_m)
    camera_m, laser_m, camera_head_m, laser_head_m = (
        frame.bring(points) for points in (camera_m, laser_m, camera_head_m, laser_head_m)
    )
    confocal = len(ordered) == 5
    if confocal:
        laser_m = camera_m
    spots = each_with_each(
        camera_m, laser_m, camera_head_m, laser_head_m, confocal=confocal, laser_outer=False
    )
    signal = _Signal(source.path, source.dataset("data"), reversed_, bounces)
    return Content(
        laser_m=spots.laser_m,
        detector_m=spots.detector_m,
        bins=ordered[1],
        bin_width_s=delta_m / C_M_PER_S,
        first_bin_s=start_m / C_M_PER_S,
        dtype=np.dtype("<f4"),
        blocks=signal.blocks(),
        delays=spots.delays,
        simulated=True,
        assumed=(
            f"all {ordered[0]} colours and the bounces {', '.join(str(one + 1) for one in bounces)} of "
            f"{ordered[2]} are added up",
            "t0 is the left edge of the first bin",
            *spots.assumed,
            *unmeasured,
            *(unlit if not confocal else ()),
        ),
        frame=frame,
    )


def _is_reversed(source: Source, shape: tuple[int, ...]) -> bool:
    """Tell the order of axes by which of them the grids of positions fit."""
    fits = []
    for reversed_ in (False, True):
        ordered = shape[::-1] if reversed_ else shape
        wanted = {"camera": ordered[3:5], "laser": ordered[5:7]}
        if len(ordered) == 5:
            wanted.pop("laser")
        if len(ordered) in {5, 7} and all(
            _grid_shape(source, f"{side}GridPositions", reversed_) == grid for side, grid in wanted.items()
        ):
            fits.append(reversed_)
    if len(fits) == 1:
        return fits[0]
    found = {name: source.shapes[name] for name in ("data", "cameraGridPositions", "laserGridPositions")}
    why = "fit together in both orders of axes" if fits else "do not fit together"
    raise DataFileError(
        f"{source.path}: {', '.join(f'{name} {held}' for name, held in found.items())} {why}; "
        "(colour, t, bounce, sx, sy[, lx, ly]) and (3, x, y) are needed, or both reversed"
    )


def _grid_shape(source: Source, name: str, reversed_: bool) -> tuple[int, ...] | None:
    shape = source.shapes[name]
    if shape is None or len(shape) != 3:
        return None
    ordered = shape[::-1] if reversed_ else shape
    return ordered[1:] if ordered[0] == 3 else None


def _points(source: Source, name: str, reversed_: bool) -> NDArray[np.float64]:
    """Return (n, 3) points, the grid's y fastest; NaN where there is none."""
    points = np.asarray(source.read(name))
    if _grid_shape(source, name, reversed_) is None or points.dtype.kind not in "uif":
        raise DataFileError(
            f"{source.path}: {name} has shape {points.shape} and type {points.dtype}; points (3, x, y), or "
            "reversed as the data are, are needed"
        )
    return (points.T if reversed_ else points).reshape(3, -1).T.astype(float)


def _bounces(source: Source, held: int, asked: tuple[int, ...] | None) -> tuple[int, ...]:
    """Return which entries of the bounce axis to take, counted from zero."""
    if asked is None:
        return tuple(range(held))
    if not asked or not set(asked) <= set(range(1, held + 1)):
        raise UsageError(
            f"{source.path} has bounces 1 to {held}; --bounces asks for {', '.join(map(str, asked))}"
        )
    return tuple(sorted({one - 1 for one in asked}))


@dataclass(frozen=True)
class _Signal:
    """The data, colours and bounces added up, as (positions, bins) blocks: laser points fastest."""

    path: Path
    dataset: h5py.Dataset
    reversed: bool
    bounces: tuple[int, ...]

    def blocks(self) -> Iterator[NDArray]:
        """Yield the signal of some of the sensor grid's lines."""
        axis = self.dataset.ndim - 4 if self.reversed else 3
        for some in spans(self.dataset, axis, _BLOCK_BYTES):
            with reading(self.path):
                block = read_part(self.dataset, *[slice(None)] * axis, some)
            block = block.T if self.reversed else block
            summed = block[:, :, list(self.bounces)].sum(axis=(0, 2), dtype=np.float64)
            yield summed.reshape(len(summed), -1).T
