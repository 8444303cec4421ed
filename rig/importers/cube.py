"""Cubes (a, b, t) in MATLAB's order of axes, from either version of its files."""

from collections.abc import Iterator

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError
from rig.files.blocks import read, spans
from rig.files.check import reading
from rig.importers.content import as_counts, stored_dtype
from rig.importers.source import Source

#: Bytes of the cube read at once.
_BLOCK_BYTES = 2**26


def cube_shape(source: Source, name: str) -> tuple[int, int, int]:
    """Return the cube's shape as MATLAB counts its axes.

    Raises
    ------
    DataFileError
        If it is no cube, or empty, or its time is on another axis than the last.
    """
    shape = source.matlab_shape(name)
    if len(shape) != 3 or 0 in shape:
        raise DataFileError(
            f"{source.path}: {name} has shape {shape}; a cube with time as its last axis is needed"
        )
    require_time_last(source, name, shape)
    return shape[0], shape[1], shape[2]


def require_time_last(source: Source, name: str, shape: tuple[int, ...]) -> None:
    """Refuse a cube whose square side lies across its last axis: that has time on another axis.

    Raises
    ------
    DataFileError
        If it does.
    """
    if shape[0] != shape[1] and shape[2] in shape[:2]:
        where = "first" if shape[1] == shape[2] else "second"
        raise DataFileError(
            f"{source.path}: {name} has shape {shape} in MATLAB's order, and time must be its last axis; of "
            f"a square of {shape[2]} x {shape[2]} spots it seems to be the {where}: permute axes to (x, y, t)"
        )


def cube_blocks(source: Source, name: str) -> tuple[np.dtype, Iterator[NDArray]]:
    """Return type and (positions, bins) blocks, the second axis of the cube fastest.

    Raises
    ------
    DataFileError
        If the cube does not hold real numbers, or is damaged.
    """
    if source.hdf5 is not None:
        dataset = source.dataset(name)
        return stored_dtype(dataset), _lines(source, dataset)
    cube = source.matlab_array(name)
    if cube.dtype.kind not in "uifb":
        raise DataFileError(f"{source.path}: {name} has type {cube.dtype}, not real numbers")
    counts = as_counts(cube.reshape(-1, cube.shape[2]))
    return counts.dtype, iter([counts])


def _lines(source: Source, dataset: h5py.Dataset) -> Iterator[NDArray]:
    """Yield lines along the cube's second axis; HDF5 shows MATLAB's axes reversed, (t, b, a)."""
    for some in spans(dataset, 2, _BLOCK_BYTES):
        with reading(source.path):
            block = read(dataset, slice(None), slice(None), some)
        yield block.transpose(2, 1, 0).reshape(-1, len(block))
