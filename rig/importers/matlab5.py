"""MATLAB v5 files, taken apart in a process of their own: the library that reads them crashes on some."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import scipy.io
from numpy.typing import NDArray

from rig.errors import DataFileError
from rig.files.trial import tried

#: MATLAB's classes that hold numbers, and the one that holds fields.
_NUMBERS = {"double", "single", "logical", *(f"{u}int{bits}" for u in ("", "u") for bits in (8, 16, 32, 64))}
_STRUCT = "struct"


class Variables:
    """The variables of a file.

    Attributes
    ----------
    shapes
        Shape of each by name, that of a struct's field by ``struct/field``; None for a struct.
    """

    def __init__(
        self, path: Path, folder: Path, shapes: dict[str, tuple[int, ...] | None], files: dict[str, str]
    ) -> None:
        self._path = path
        self._folder = folder
        self._files = files
        self.shapes = shapes

    def read(self, name: str) -> NDArray:
        """Return a variable or a field.

        Raises
        ------
        DataFileError
            If it does not hold numbers.
        """
        if name not in self._files:
            raise DataFileError(f"{self._path}: '{name}' has a type that is not real numbers")
        values: NDArray = np.load(self._folder / self._files[name], allow_pickle=False)
        return values


@contextmanager
def open_variables(path: Path) -> Iterator[Variables]:
    """Take a file apart; its arrays are kept beside until the block ends.

    Raises
    ------
    DataFileError
        If it is damaged, or needs more memory than a file of its size can be worth.
    """
    with TemporaryDirectory(prefix="rig-import-") as folder:
        found = tried(path, take_apart, folder)
        shapes = {name: None if shape is None else tuple(shape) for name, shape, _ in found}
        files = {name: file for name, _, file in found if file}
        yield Variables(path, Path(folder), shapes, files)


def take_apart(path: str, folder: str) -> list[tuple[str, tuple[int, ...] | None, str]]:
    """Write the arrays of a file into a folder; return name, shape and file of each; '' where no numbers.

    Raises
    ------
    DataFileError
        If the file is damaged.
    """
    warnings.simplefilter("ignore")
    found: list[tuple[str, tuple[int, ...] | None, str]] = []

    def keep(name: str, value: object) -> None:
        array = np.asarray(value)
        numbers = array.dtype.kind in "uifbc"
        if numbers:
            np.save(Path(folder) / f"{len(found)}.npy", array, allow_pickle=False)
        found.append((name, array.shape, f"{len(found)}.npy" if numbers else ""))

    try:
        for name, shape, kind in scipy.io.whosmat(path):
            if kind != _STRUCT and kind not in _NUMBERS:
                found.append((name, shape, ""))
                continue
            value = scipy.io.loadmat(path, variable_names=[name])[name]
            if kind == _STRUCT:
                found.append((name, None, ""))
                for field in (value.dtype.names or ()) if value.size == 1 else ():
                    keep(f"{name}/{field}", value[field].ravel()[0])
            else:
                keep(name, value)
    except MemoryError:
        raise
    except Exception as error:  # a damaged file may fail in any way
        raise DataFileError(f"{path} is a damaged MATLAB file: {error}; copy it again") from error
    return found
