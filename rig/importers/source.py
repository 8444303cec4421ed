"""A file of unknown layout, opened far enough to see what it holds."""

from collections.abc import Iterator
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError, in_a_line, no_file, reason
from rig.files.blocks import read
from rig.files.check import open_hdf5, plain, reading
from rig.files.older import is_older, read_older_head
from rig.files.picoquant import MAGIC_HISTOGRAMS, MAGIC_RECORDS, Head, read_head
from rig.importers.matlab5 import Variables, open_variables

#: How files begin that people also keep transients in, and what they are.
_FOREIGN = {
    b"\x93NUMPY": "an array of NumPy (.npy)",
    b"PK\x03\x04": "an archive, as NumPy's .npz are",
    b"\x80": "a pickle of Python's",
}
#: Chunks that a dataset may claim for each that was written, and bytes without chunks that were not.
_MOST_UNWRITTEN, _MOST_ZEROS_BYTES = 1000, 2**24
#: Words that a flag may hold, and how numbers are written that mean the same.
_YES, _NO = {"true", "yes", "1", "1.0"}, {"false", "no", "0", "0.0"}


class Source:
    """An HDF5 file (MATLAB v7.3 is one), a MATLAB v5 file, or a file of PicoQuant's.

    Attributes
    ----------
    path
        Where it is.
    shapes
        Shape of each array by its name, ``group/name`` in a group or struct at the top level; None for
        groups, structs and empty placeholders.
    hdf5
        The open file of HDF5, else None.
    variables
        Of MATLAB v5, else None.
    head
        Of PicoQuant's, else None; `shapes` has the names of its tags then.
    """

    def __init__(
        self,
        path: Path,
        shapes: dict[str, tuple[int, ...] | None],
        hdf5: h5py.File | None = None,
        variables: Variables | None = None,
        head: Head | None = None,
    ) -> None:
        self.path = path
        self.shapes = shapes
        self.hdf5 = hdf5
        self.variables = variables
        self.head = head

    @property
    def matlab5(self) -> bool:
        """Whether it is a MATLAB v5 file."""
        return self.variables is not None

    def has(self, *names: str) -> bool:
        """Return whether it holds all these names."""
        return set(names) <= set(self.shapes)

    def holds(self, *parts: str) -> bool:
        """Return whether it holds all these parts.

        A part is a name, the name of a ``.mat`` file beside it, or several with ``or`` between them.
        """
        return all(
            any(
                self.path.with_name(one).is_file() if one.endswith(".mat") else self.has(one)
                for one in either
            )
            for either in (part.split(" or ") for part in parts)
        )

    def read(self, name: str) -> Any:
        """Return a variable whole: in the order of its file, so MATLAB v7.3 arrays come transposed.

        Raises
        ------
        DataFileError
            If it is missing or damaged.
        """
        if name not in self.shapes:
            raise DataFileError(f"{self.path} lacks '{name}'; it holds {self.contents()}")
        if self.variables is not None:
            return self.variables.read(name)
        assert self.hdf5 is not None
        with reading(self.path):
            return None if self.shapes[name] is None else read(self.hdf5[name])

    def dataset(self, name: str) -> h5py.Dataset:
        """Return an array of an HDF5 file, to be read in parts.

        Raises
        ------
        DataFileError
            If it does not hold real numbers, or is damaged.
        """
        assert self.hdf5 is not None
        with reading(self.path):  # a type that no numbers here have is refused when it is asked for
            dataset: h5py.Dataset = self.hdf5[name]
            if dataset.dtype.kind not in "uif":
                raise DataFileError(f"{self.path}: {name} has type {dataset.dtype}, not real numbers")
        return dataset

    def require_written(self) -> None:
        """Refuse a file of HDF5 with an array that claims far more than was ever written.

        Raises
        ------
        DataFileError
            If there is one, or the file is damaged.
        """
        if self.hdf5 is None:
            return
        for name, shape in self.shapes.items():
            if shape is not None:
                with reading(self.path):
                    _check_written(self.path, self.hdf5[name])

    def matlab_shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of an array as MATLAB counts its axes; empty where there is none."""
        shape = self.shapes.get(name) or ()
        return shape if self.matlab5 else shape[::-1]

    def matlab_array(self, name: str) -> NDArray:
        """Return an array whole, its axes as MATLAB counts them, whichever version the file has.

        Raises
        ------
        DataFileError
            If it is missing or damaged.
        """
        value = np.asarray(self.read(name))
        return value if self.matlab5 else value.T

    def numbers(self, name: str, *shape: int) -> NDArray[np.float64]:
        """Return a numeric variable as float64 of this shape; -1 stands for any size.

        Raises
        ------
        DataFileError
            If it is missing, not numeric, not finite, or of another shape.
        """
        value = np.asarray(self.read(name))
        fits = value.dtype.kind in "fiub" and value.size > 0
        if fits:
            value = value.astype(float)
            try:
                value = value.reshape(shape)
            except ValueError:
                fits = False
        if not fits or not np.isfinite(value).all():
            raise DataFileError(
                f"{self.path}: '{name}' has shape {np.shape(value)} and type {value.dtype}; "
                f"finite numbers of shape {shape} are needed"
            )
        return value

    def places(self, name: str) -> NDArray[np.float64]:
        """Return an array (..., 3) or (3, ...) of points as (n, 3); NaN where a point has no place.

        Where both the first and the last axis have three entries, the last one holds the coordinates.

        Raises
        ------
        DataFileError
            If it is missing, not numeric, or of another shape.
        """
        return self._points(name, np.asarray(self.read(name)))

    def matlab_places(self, name: str) -> NDArray[np.float64]:
        """Return a MATLAB array (..., 3) or (3, ...) of points as (n, 3), whichever version the file has.

        Raises as `places`.
        """
        return self._points(name, self.matlab_array(name))

    def _points(self, name: str, value: NDArray) -> NDArray[np.float64]:
        if value.dtype.kind not in "fiu" or not value.size or 3 not in {*value.shape[:1], *value.shape[-1:]}:
            raise DataFileError(
                f"{self.path}: '{name}' has shape {value.shape} and type {value.dtype}; points of three "
                "numbers x, y, z are needed, on the last axis or the first"
            )
        return (value if value.shape[-1] == 3 else np.moveaxis(value, 0, -1)).reshape(-1, 3).astype(float)

    def attribute(self, name: str, default: Any = None) -> Any:
        """Return a root attribute of an HDF5 file as a Python value."""
        assert self.hdf5 is not None
        with reading(self.path):
            return plain(self.hdf5.attrs.get(name, default))

    def attribute_numbers(self, name: str, size: int) -> NDArray[np.float64] | None:
        """Return a root attribute of an HDF5 file as float64 of this size; None where there is none.

        Raises
        ------
        DataFileError
            If it does not hold as many finite numbers.
        """
        assert self.hdf5 is not None
        with reading(self.path):
            if name not in self.hdf5.attrs:
                return None
            value = np.asarray(self.hdf5.attrs[name])
        if value.dtype.kind not in "fiu" or value.size != size or not np.isfinite(value).all():
            raise DataFileError(
                f"{self.path}: attribute '{name}' is {value}; {size} finite numbers are needed"
            )
        return value.astype(float).reshape(size)

    def attribute_number(self, name: str, default: float) -> float:
        """Return a root attribute of an HDF5 file as a number; ``default`` where there is none.

        Raises
        ------
        DataFileError
            If it is not one finite number.
        """
        value = self.attribute_numbers(name, 1)
        return default if value is None else float(value[0])

    def attribute_flag(self, name: str) -> bool | None:
        """Return a root attribute of an HDF5 file as yes or no; None where there is none.

        Raises
        ------
        DataFileError
            If it is neither a number nor a word that says yes or no.
        """
        value = self.attribute(name)
        word = str(value).strip().lower()
        if value is None or word in _NO | _YES:
            return None if value is None else word in _YES
        raise DataFileError(f"{self.path}: attribute '{name}' is {value!r}; true or false is needed")

    def contents(self, named: int = 100) -> str:
        """Return what it holds, in words: as many names, and how many more there are."""
        parts = [name if shape is None else f"{name} {shape}" for name, shape in sorted(self.shapes.items())]
        more = f" and {len(parts) - named} more" if len(parts) > named else ""
        return (", ".join(map(in_a_line, parts[:named])) or "nothing") + more


def _check_written(path: Path, dataset: h5py.Dataset) -> None:
    """Refuse a dataset that claims far more than was ever written.

    Reading its zeros may take hours, and so many places more memory than there is.
    """
    if dataset.chunks is None:
        whole_bytes = prod(dataset.shape) * dataset.id.get_type().get_size()
        if not dataset.id.get_storage_size() and whole_bytes > _MOST_ZEROS_BYTES:
            raise DataFileError(f"{path}: {dataset.name} has shape {dataset.shape}, but was never written")
        return
    claimed = prod(-(-size // chunk) for size, chunk in zip(dataset.shape, dataset.chunks, strict=True))
    written = dataset.id.get_num_chunks()
    if claimed > _MOST_UNWRITTEN * (1 + written):
        raise DataFileError(
            f"{path}: {dataset.name} has shape {dataset.shape}, but {written} chunks of {claimed:,} were "
            "written; it is damaged, or its measurement ended early: copy the measured part to a new file"
        )


@contextmanager
def open_source(path: Path) -> Iterator[Source]:
    """Open a file by its content, whatever its name.

    Raises
    ------
    DataFileError
        If it is missing, damaged, or of none of these kinds.
    """
    if not path.is_file():
        raise DataFileError(no_file(path))
    try:
        with path.open("rb") as file:
            head = file.read(128)
    except OSError as error:
        raise DataFileError(f"{path} cannot be read ({reason(error)}); check its permissions") from None
    if head.startswith(b"MATLAB 5.0"):
        with open_variables(path) as variables:
            yield Source(path, variables.shapes, variables=variables)
    elif h5py.is_hdf5(path):
        with open_hdf5(path) as hdf5:
            with reading(path):
                shapes = dict(_members(hdf5))
            yield Source(path, shapes, hdf5=hdf5)
    elif head.startswith((MAGIC_RECORDS, MAGIC_HISTOGRAMS)) or is_older(head):
        tags = read_older_head(path) if is_older(head) else read_head(path)
        yield Source(path, dict.fromkeys(tags.values), head=tags)
    else:
        raise DataFileError(
            f"{path} is neither HDF5, nor MATLAB, nor a file of PicoQuant's: {_unlike(head)}; give one of "
            "these, or write its arrays as neutral HDF5, for which docs/importing.md has a program"
        )


def _unlike(head: bytes) -> str:
    """Say what a file is instead, by how it begins."""
    if not head:
        return "it is empty"
    for sign, what in _FOREIGN.items():
        if head.startswith(sign):
            return f"it is {what}"
    if all(byte in b"\t\r\n" or 32 <= byte < 127 for byte in head):
        return "it is text, " + repr(head[:24].decode("ascii"))
    return f"it begins with {head[:12]!r}"


def _members(group: h5py.Group, prefix: str = "") -> Iterator[tuple[str, tuple[int, ...] | None]]:
    """Yield name and shape of the members of a file, and of its groups, leaving out MATLAB's own."""
    for name, member in group.items():
        if name.startswith("#"):
            continue
        yield prefix + name, member.shape if isinstance(member, h5py.Dataset) else None
        if isinstance(member, h5py.Group) and not prefix:
            yield from _members(member, f"{name}/")
