"""Reading a binary head by tables of its fields, each held against the size of the file first."""

from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError

#: More curves than any of these instruments keeps (a HydraHarp has 512 places for them).
MOST_CURVES = 65_536


#: Name, type and shape of a field; one called ``pad`` is not looked at.
Field = tuple[str, str] | tuple[str, str, tuple[int, ...]]


def table(*fields: Field) -> np.dtype:
    """Return fields as they follow one another, without gaps."""
    named = [
        (f"{field[0]} {i}" if field[0] == "pad" else field[0], *field[1:]) for i, field in enumerate(fields)
    ]
    return np.dtype(named)


def integers(names: str) -> list[Field]:
    """Return fields of 32 bits of these names."""
    return [(name, "<i4") for name in names.split()]


#: How all older heads end that belong to the program that wrote them, and not to the instrument: what curves
#: are shown, how a measurement is repeated, by which script.
DISPLAY: tuple[Field, ...] = (
    ("pad", "<i4", (8, 2)),
    ("pad", "<f4", (3, 3)),
    ("pad", "<i4", (4,)),
    ("pad", "S20"),
)
#: What begins the files that name the program that wrote them.
CREATED: tuple[Field, ...] = (
    ("pad", "S16"),
    ("pad", "S6"),
    ("pad", "S18"),
    ("pad", "S12"),
    ("pad", "S18"),
    ("pad", "S2"),
    ("pad", "S256"),
)


class Fields:
    """A head that is read from its start on, table after table.

    Attributes
    ----------
    path, size
        The file, and its size [bytes].
    """

    def __init__(self, file: BinaryIO, path: Path, size: int) -> None:
        self._file = file
        self.path = path
        self.size = size

    @property
    def place(self) -> int:
        """How far it was read [bytes]."""
        return self._file.tell()

    def take(self, of: np.dtype) -> Any:
        """Read the fields of a table.

        Raises
        ------
        DataFileError
            If the file ends before.
        """
        return self.rows(of, 1, "")[0]

    def rows(self, of: np.dtype, number: int, what: str) -> NDArray[Any]:
        """Read a table so many times.

        Parameters
        ----------
        of, number
            The table, and how often the head says that it follows.
        what
            What a row describes, for the error, e.g. ``input``.

        Raises
        ------
        DataFileError
            If the number is negative, or the file ends before.
        """
        left = self.size - self.place
        if number < 0 or number * of.itemsize > left:
            said = f"says that {number:,} {what}s follow, and the file" if what else "goes on, and the file"
            raise DataFileError(
                f"{self.path}: its header {said} ends after {self.size:,} bytes: it is cut off, or damaged"
            )
        raw = self._file.read(number * of.itemsize)
        return np.frombuffer(raw, of, number)

    def go_to(self, place: int) -> None:
        """Read on from a place [bytes]."""
        self._file.seek(place)

    def damaged(self, what: str) -> DataFileError:
        """Return the error that says so."""
        return DataFileError(f"{self.path}: its header says {what}; it is damaged")
