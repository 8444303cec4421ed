"""Reading NumPy's ``.npz`` from outside: plain numbers alone, no larger than the file can be worth."""

from math import prod
from pathlib import Path
from zipfile import BadZipFile, ZipFile
from zlib import error as ZlibError  # noqa: N812

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

#: Bytes unpacked: some for any file, and some for each of its bytes. A zip file of zeros unpacks 1000:1.
MOST_BYTES, MOST_PER_BYTE = 2**27, 32


def read_npz(path: Path) -> dict[str, NDArray]:
    """Return the arrays of a file by name.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is damaged, holds Python objects, or claims more than it can hold.
    """
    try:
        with ZipFile(path) as packed:
            _check(packed, MOST_BYTES + MOST_PER_BYTE * path.stat().st_size)
        with np.load(path, allow_pickle=False) as held:
            return {name: held[name] for name in held.files}
    except (BadZipFile, EOFError, AttributeError, KeyError, NotImplementedError, RuntimeError) as error:
        raise ValueError(str(error)) from None
    except (SyntaxError, TypeError, MemoryError, OverflowError, ZlibError) as error:
        raise ValueError(f"it is damaged ({error})") from None


def _check(packed: ZipFile, most_bytes: int) -> None:
    """Hold what each member says of itself against its size, before anything is unpacked."""
    claimed = 0
    for member in packed.infolist():
        with packed.open(member) as file:
            if npy.read_magic(file) == (1, 0):
                shape, _, dtype = npy.read_array_header_1_0(file)
            else:
                shape, _, dtype = npy.read_array_header_2_0(file)
        if dtype.hasobject:
            raise ValueError(f"{member.filename} holds Python objects, which are never loaded")
        array_bytes = prod(shape) * dtype.itemsize
        if min(shape, default=0) < 0 or array_bytes > member.file_size:
            raise ValueError(f"{member.filename} claims {array_bytes} bytes, but has {member.file_size}")
        claimed += array_bytes
    if claimed > most_bytes:
        raise ValueError(f"it claims {claimed} bytes; at most {most_bytes} are read from a file of its size")
