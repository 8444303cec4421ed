"""A scan file whose program was killed, made sound again before anything is added to it.

After a kill in the middle of a flush the index of chunks may know chunks that lie beyond the end that the
file's header knows. What is marked as done is never among them, so reading is safe; but HDF5 would place new
chunks over them, or refuse. A fresh copy of what is marked has no such past.
"""

import os
from pathlib import Path

import h5py
import numpy as np

from rig.atomic import appearing


def salvage(path: Path) -> None:
    """Replace a scan file by a copy that holds its measured positions and nothing unfinished.

    Chunks are copied as they are, compressed. The file changes at once or not at all.

    Raises
    ------
    OSError, RuntimeError
        If the file cannot be read, or the copy not written.
    """
    with appearing(path) as partial:
        with h5py.File(path, "r") as old, h5py.File(partial, "x") as new:
            new.attrs.update(old.attrs)
            for name in old:
                if name != "transients":
                    old.copy(name, new)
            _copy_transients(old["transients"], new.create_group("transients"))
        with partial.open("rb+") as file:
            os.fsync(file.fileno())  # the old file is gone the moment this one takes its name


def _copy_transients(old: h5py.Group, new: h5py.Group) -> None:
    new.attrs.update(old.attrs)
    for name in old:
        if name != "counts":
            old.copy(name, new)
    counts, done = old["counts"], old["done"][()]
    copied = new.create_dataset(
        "counts",
        counts.shape,
        counts.dtype,
        chunks=counts.chunks,
        compression=counts.compression,
        compression_opts=counts.compression_opts,
        shuffle=counts.shuffle,
    )
    copied.attrs.update(counts.attrs)
    measured = int(np.flatnonzero(done)[-1]) + 1 if done.any() else 0
    for start in range(0, measured, counts.chunks[0]):
        place = (start, *(0 for _ in counts.shape[1:]))
        filter_mask, chunk = counts.id.read_direct_chunk(place)
        copied.id.write_direct_chunk(place, chunk, filter_mask)
