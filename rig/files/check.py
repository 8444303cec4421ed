"""Opening HDF5 files that may be anything, and holding them against a layout."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rig.errors import DataFileError, in_a_line, no_file, reason
from rig.files.inspection import inspect
from rig.files.layout import TYPES, Entry, Layout
from rig.files.opened import hdf5_file

#: What files of this program are called, and what to do with one where another kind is wanted.
_OWN = {
    "rig-scan": ("a scan", "image it first, with rig recon"),
    "rig-volume": ("a volume", "give the scan that it was made from"),
}
#: What h5py raises on damaged content. A member that cannot be opened is None to it, which lacks every
#: attribute; JSON may be nested too deep.
_DAMAGE = (
    OSError,
    RuntimeError,  # RecursionError is one
    KeyError,
    ValueError,
    TypeError,
    OverflowError,
    AttributeError,
    MemoryError,
)


def open_hdf5(path: Path) -> h5py.File:
    """Open an HDF5 file for reading.

    Raises
    ------
    DataFileError
        If it is missing, no HDF5 file, truncated, held by a program that writes to it, or not fit to be read:
        see `rig.files.inspection`.
    """
    if not os.path.isfile(path):
        raise DataFileError(no_file(path))
    inspect(path)
    try:
        return hdf5_file(path, "r")
    except BlockingIOError:
        raise DataFileError(f"{path} is being written by another program; wait until it has ended") from None
    except OSError as error:
        if "unable to lock" in str(error):
            raise DataFileError(
                f"{path} is being written by another program; wait until it has ended"
            ) from None
        if "truncated" in str(error):
            raise DataFileError(
                f"{path} is truncated: its end is missing, so its content is not reliable; copy it again"
            ) from None
        if error.errno is not None:  # the system's word, as of a permission
            raise DataFileError(f"{path} cannot be read ({reason(error)}); check its permissions") from None
        what = "is not an HDF5 file, or its header is damaged" if os.path.getsize(path) else "is empty"
        raise DataFileError(f"{path} {what}; copy it again, or give a file of this program") from None


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn what h5py raises on damaged content into an error that names the file."""
    try:
        yield
    except _DAMAGE as error:
        raise DataFileError(f"{path} is damaged: {error}; copy it again, or measure again") from error


def check_format(path: Path, file: h5py.File, name: str, versions: tuple[int, ...]) -> int:
    """Return the version of a file; raise DataFileError unless it has this format and such a version."""
    found = plain(file.attrs.get("format"))
    if found != name:
        if found in _OWN and name in _OWN:
            what, remedy = _OWN[found]
            raise DataFileError(f"{path} is {what}, but {_OWN[name][0]} is needed; {remedy}")
        what = f"its format attribute is {found!r}" if found is not None else "it has no format attribute"
        held = ", ".join(map(in_a_line, sorted(file))) or "nothing"
        raise DataFileError(
            f"{path} is not a {name} file: {what}, and it holds {held}. "
            "Transients in other layouts are read with 'rig import'"
        )
    found = plain(file.attrs.get("version"))
    if found not in versions:
        known = " and ".join(map(str, versions))
        raise DataFileError(
            f"{path} has version {found!r} of {name}; this program reads version {known}; update it"
        )
    return int(found)


def check_layout(path: Path, file: h5py.File, layout: Layout) -> dict[str, int]:
    """Hold a file against its layout.

    Returns
    -------
    The sizes found, by the names that the layout gives them.

    Raises
    ------
    DataFileError
        That lists everything that is missing, of another type or of another shape.
    """
    sizes: dict[str, int] = {}
    problems = []
    for pattern, entry in layout.items():
        owner, _, attribute = pattern.partition("@")
        for place in _places(file, owner):
            found = place is not None and (not attribute or attribute in place.attrs)
            if not found:
                if entry.required:
                    problems.append(f"{pattern} is missing")
                continue
            problem = (
                _wrong_attribute(place.attrs[attribute], entry)
                if attribute
                else _wrong_object(place, entry, sizes)
            )
            if problem:
                problems.append(f"{pattern} {problem}")
    if problems:
        raise DataFileError(
            f"{path} does not follow its layout: {'; '.join(problems)}. "
            "See docs/scan-file.md for what it must hold"
        )
    return sizes


def plain(value: Any) -> Any:
    """Return an attribute as a Python value: text decoded, arrays of one element opened."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, np.ndarray) and value.size == 1:
        return plain(value.reshape(-1)[0])
    return value.item() if isinstance(value, np.generic) else value


def _places(file: h5py.File, owner: str) -> list[Any]:
    """Return the objects at a path, None where there is none; ``/*`` stands for all members of a group."""
    if owner.endswith("/*"):
        group = file.get(owner[:-2])
        return list(group.values()) if isinstance(group, h5py.Group) else []
    return [file.get(owner)]


def _wrong_attribute(value: Any, entry: Entry) -> str:
    value = plain(value)
    if entry.type in {"text", "json"}:
        fits = isinstance(value, str)
    elif entry.type == "flag":
        fits = isinstance(value, bool | int)
    elif entry.type == "whole":
        fits = isinstance(value, int)
    elif entry.shape:
        fits = isinstance(value, np.ndarray) and value.shape == entry.shape and value.dtype.kind in "fiu"
    else:
        fits = isinstance(value, int | float)
    if fits and entry.type == "number" and not np.all(np.isfinite(value)):
        return f"is {value}, not a finite number"
    return "" if fits else f"is {value!r}, not {entry.kind}"


def _wrong_object(place: Any, entry: Entry, sizes: dict[str, int]) -> str:
    if entry.type == "group":
        return "" if isinstance(place, h5py.Group) else "is not a group"
    if not isinstance(place, h5py.Dataset) or place.shape is None:
        return "is not a dataset"
    kinds = {
        "counts": "uif",
        "unsigned": "ui",
        "float": "f",
        "bool": "bu",
        "document": "OSU",
        "texts": "OSU",
        "integer": "ui",
        "table": "V",
    }[entry.type]
    if place.dtype.kind not in kinds:
        return f"has type {place.dtype}, not {TYPES[entry.type]}"
    if not _shape_fits(place.shape, entry.shape, sizes):
        wanted = ", ".join(
            f"{size} = {sizes[size]}" if isinstance(size, str) and size in sizes else str(size)
            for size in entry.shape
        )
        return f"has shape {place.shape}, not ({wanted})"
    return ""


def _shape_fits(shape: tuple[int, ...], wanted: tuple[int | str, ...], sizes: dict[str, int]) -> bool:
    if wanted == ("any",):
        return len(shape) == 1
    if wanted and wanted[0] == "...":
        wanted = wanted[1:]
        shape = shape[-len(wanted) :]
    if len(shape) != len(wanted):
        return False
    for size, want in zip(shape, wanted, strict=True):
        if isinstance(want, int):
            fits = size == want
        elif "*" in want:
            fits = size == prod(sizes.get(name, size) for name in want.removesuffix("+1").split("*")) + (
                want.endswith("+1")
            )
        elif "|" in want:
            either, name = want.split("|")
            fits = size in {int(either), sizes.get(name, size)}
        elif want.endswith("+1"):
            fits = size == sizes.setdefault(want[:-2], size - 1) + 1
        else:
            fits = size == sizes.setdefault(want, size)
        if not fits:
            return False
    return True
