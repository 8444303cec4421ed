"""Liu et al. 2019 (phasor field virtual wave optics), as released: MATLAB v7.3 with the group ``dataset``.

As HDF5 shows it: ``data`` (t, detector, laser), one detector; ``deltat`` bin width and ``t0`` start, both
metres of optical path; ``laserPos``, ``cameraPos`` and their normals (3, n) or (n, 3); ``laserOrigin``,
``cameraOrigin`` (3). The time includes the legs from the laser's head to the wall and from the wall to
the detector.
"""

from collections.abc import Iterator

import h5py
import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from rig.errors import DataFileError
from rig.files.blocks import read as read_part
from rig.files.blocks import spans
from rig.files.check import reading
from rig.importers.content import Content, stored_dtype
from rig.importers.options import Options
from rig.importers.places import zeros_as_missing
from rig.importers.source import Source
from rig.importers.wall import WallFrame, named
from rig.model.delays import PathDelays

NAME = "Liu 2019, phasor field"
SIGN = "MATLAB v7.3 with dataset/data (t, detector, laser), dataset/laserPos and dataset/deltat"
PARTS = ("dataset/data", "dataset/laserPos", "dataset/deltat")
#: Bytes of data read at once.
_BLOCK_BYTES = 2**26


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return not source.matlab5 and source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the file, block by block.

    Raises
    ------
    DataFileError
        If there is more than one detector, or arrays do not fit together.
    """
    (laser_m,), unmeasured = zeros_as_missing(_points(source, "laserPos"))
    camera_m = _points(source, "cameraPos")
    shape = source.shapes["dataset/data"]
    if shape is None or len(shape) != 3 or shape[1:] != (1, len(laser_m)) or len(camera_m) != 1:
        raise DataFileError(
            f"{source.path}: dataset/data has shape {shape} with {len(laser_m)} laser and {len(camera_m)} "
            "camera points; (t, 1, laser points) and one camera point are needed"
        )
    delta_m, start_m = (source.numbers(f"dataset/{name}", 1)[0] for name in ("deltat", "t0"))
    if not delta_m > 0:
        raise DataFileError(f"{source.path}: dataset/deltat is {delta_m} m; it must be positive")
    laser_head_m, camera_head_m = (
        source.numbers(f"dataset/{name}", 3) for name in ("laserOrigin", "cameraOrigin")
    )
    normals = _points(source, "laserNorm") if source.has("dataset/laserNorm") else None
    with named(source.path):
        frame = WallFrame.of(laser_m, normals, laser_head_m)
    dataset = source.dataset("dataset/data")
    return Content(
        laser_m=frame.bring(laser_m),
        detector_m=frame.bring(camera_m),
        bins=shape[0],
        bin_width_s=delta_m / C_M_PER_S,
        first_bin_s=start_m / C_M_PER_S,
        dtype=stored_dtype(dataset),
        blocks=_blocks(source, dataset),
        delays=PathDelays(frame.bring(laser_head_m), frame.bring(camera_head_m)),
        assumed=("t0 is the left edge of the first bin", *unmeasured),
        frame=frame,
    )


def _points(source: Source, name: str) -> NDArray[np.float64]:
    """Return (n, 3) points that are stored so, or transposed as MATLAB v7.3 does; NaN where there is none."""
    points = np.asarray(source.read(f"dataset/{name}"))
    if points.ndim == 2 and points.shape[0] == 3:
        points = points.T
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "uif" or not points.size:
        raise DataFileError(
            f"{source.path}: dataset/{name} has shape {points.shape}; (3, n) or (n, 3) is needed"
        )
    return points.astype(float)


def _blocks(source: Source, dataset: h5py.Dataset) -> Iterator[NDArray]:
    for some in spans(dataset, 2, _BLOCK_BYTES):
        with reading(source.path):
            block = read_part(dataset, slice(None), slice(0, 1), some)
        yield block[:, 0].T
