"""MATLAB v5 of a volume: ``intensity`` (z, y, x), its axes as rows, and its parameters as JSON text."""

import json
from pathlib import Path
from typing import Any

import scipy.io

from rig.errors import UsageError
from rig.exporters.arrays import volume_arrays
from rig.files import Volume

NAME = "MATLAB v5"
ENDINGS = (".mat",)
#: The layout counts the bytes of a variable, its head included, in 32 bits.
LARGEST_BYTES = 2**32 - 2**10


def write(path: Path, volume: Volume) -> None:
    """Write the file.

    Raises
    ------
    UsageError
        If the volume is larger than the layout can hold.
    """
    save(path, {**volume_arrays(volume), "parameters": json.dumps(dict(volume.parameters))})


def save(path: Path, variables: dict[str, Any]) -> None:
    """Write variables, compressed.

    Raises
    ------
    UsageError
        If one of them is larger than the layout can hold.
    """
    for name, value in variables.items():
        refuse_larger(path, name, getattr(value, "nbytes", 0))
    scipy.io.savemat(path, variables, do_compression=True, oned_as="row")


def refuse_larger(path: Path, name: str, size_bytes: int) -> None:
    """Raise UsageError if a variable does not fit the layout."""
    if size_bytes > LARGEST_BYTES:
        raise UsageError(
            f"{name} has {size_bytes / 2**30:.1f} GiB, but MATLAB v5 holds at most 4 GiB a variable; "
            "MATLAB reads this program's own HDF5 files with h5read"
        )
