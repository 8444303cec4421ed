"""The head of PicoQuant's unified files (``.ptu``, ``.phu``): tags, read and written.

Eight bytes say what the file is and eight its version; tags follow until ``Header_End``, each with a name of
32 bytes, an index (-1 where there is one value alone), a type and eight bytes of value. Texts, arrays and
blobs have their length there, and lie behind (source: the vendor's description of the unified format).
"""

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from rig.errors import DataFileError, printable

MAGIC_RECORDS, MAGIC_HISTOGRAMS = b"PQTTTR\0\0", b"PQHISTO\0"

#: Where our own files keep what records cannot say; other programs pass over it.
#: Spots [m]: the laser's (P, 3), and the detector's (1 or P, C, 3).
LASER, DETECTOR = "NLOS_LaserSpots", "NLOS_DetectorSpots"
#: Inputs of the C channels, (C,); left edge of dtime 0 [s]; what to subtract for rectified time [s], (P, C).
INPUTS, FIRST_BIN, DELAY, BINS = "NLOS_Inputs", "NLOS_FirstBin", "NLOS_Delay", "NLOS_Bins"
#: Rectified time before which the record holds the wall's own light [s].
FADE = "NLOS_FadeFrom"
#: Of a file that was recorded while the scan ran, in which a line may be twice. For each sweep of the mirror
#: the sync pulse with which it begins and its first step, (K, 2), -1 for sweeps that did not come; how many
#: steps can be trusted, -1 where nobody said; by how much the mirror trails its command [s];
#: exposures [s], (P,).
SWEEPS, STEPS, LAG, EXPOSURE = "NLOS_Sweeps", "NLOS_Steps", "NLOS_Lag", "NLOS_Exposures"
#: Markers of a point, a line and a frame, counted from 1.
POINT_MARKER, LINE_MARKER, FRAME_MARKER = 1, 2, 3

_EMPTY, _BOOL, _INT, _BITS, _COLOR = 0xFFFF0008, 0x00000008, 0x10000008, 0x11000008, 0x12000008
_FLOAT, _TIME = 0x20000008, 0x21000008
_INTS, _FLOATS, _TEXT, _WIDE, _BLOB = 0x1001FFFF, 0x2001FFFF, 0x4001FFFF, 0x4002FFFF, 0xFFFFFFFF
_TAG = struct.Struct("<32siI8s")
_VERSION = b"1.0.00\0\0"
#: A head of more tags, or more bytes in one of them, is damaged: real ones have some hundred tags.
_MOST_TAGS, _MOST_BYTES = 100_000, 2**28


@dataclass(frozen=True)
class Head:
    """The tags of a file.

    Attributes
    ----------
    path
        The file.
    magic
        Its first eight bytes.
    values
        By name; a list, in the order of indices, where there are several values.
    end
        Where the head ends and data may begin [bytes].
    size
        Size of the file [bytes].
    """

    path: Path
    magic: bytes
    values: dict[str, Any] = field(default_factory=dict)
    end: int = 0
    size: int = 0

    def number(self, name: str, default: float | None = None) -> float:
        """Return a numeric tag.

        Raises
        ------
        DataFileError
            If it is missing and there is no default, or it is not a finite number.
        """
        value = self.values.get(name, default)
        if not isinstance(value, int | float) or not np.isfinite(value):
            what = "is missing" if value is None else f"is {value!r}, not a number"
            raise DataFileError(
                f"{self.path}: the tag {name} of its header {what}; the file is damaged, or not finished"
            )
        return value

    def numbers(self, name: str) -> np.ndarray:
        """Return an array tag, or a tag with indices, as float64.

        Raises
        ------
        DataFileError
            If it is missing, or holds what are no finite numbers.
        """
        value = self.values.get(name)
        try:
            array = np.atleast_1d(np.asarray(value, float))
        except (TypeError, ValueError):
            array = np.array([np.nan])
        if value is None or array.ndim > 1 or not np.isfinite(array).all():
            raise DataFileError(
                f"{self.path}: the tag {name} of its header is missing, or is not a list of numbers"
            )
        return array


def read_head(path: Path) -> Head:
    """Read a unified file's head.

    Raises
    ------
    DataFileError
        If it is damaged, or does not come to its end.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        magic, _version = file.read(8), file.read(8)
        indexed: dict[str, dict[int, Any]] = {}
        for name, index, value in _tags(file, path, size):
            indexed.setdefault(name, {})[index] = value
        end = file.tell()
    values = {
        name: of_index[-1] if -1 in of_index else [of_index[i] for i in sorted(of_index)]
        for name, of_index in indexed.items()
    }
    return Head(path, magic, values, end, size)


def _tags(file: BinaryIO, path: Path, size: int) -> Iterator[tuple[str, int, Any]]:
    for _ in range(_MOST_TAGS):
        raw = file.read(_TAG.size)
        if len(raw) < _TAG.size:
            raise DataFileError(
                f"{path} ends within its header, after {size:,} bytes: it is cut off, or damaged"
            )
        name_bytes, index, kind, value = _TAG.unpack(raw)
        name = printable(name_bytes.rstrip(b"\0").decode("latin-1"))
        if name == "Header_End":
            return
        yield name, index, _value(file, path, size, (name, kind, value))
    raise DataFileError(f"{path}: its header has more than {_MOST_TAGS:,} tags; it is damaged")


def _value(file: BinaryIO, path: Path, size: int, tag: tuple[str, int, bytes]) -> Any:
    """Return a tag's value, read behind it where it has a length."""
    name, kind, value = tag
    whole, real = struct.unpack("<q", value)[0], struct.unpack("<d", value)[0]
    simple = {
        _EMPTY: None,
        _BOOL: bool(whole),
        _INT: whole,
        _BITS: whole,
        _COLOR: whole,
        _FLOAT: real,
        _TIME: real,
    }
    if kind in simple:
        return simple[kind]
    if kind not in {_INTS, _FLOATS, _TEXT, _WIDE, _BLOB}:
        raise DataFileError(
            f"{path}: the tag {name} of its header has the unknown type {kind:#010x}; it is damaged"
        )
    if not 0 <= whole <= min(_MOST_BYTES, size - file.tell()):
        raise DataFileError(
            f"{path}: the tag {name} of its header claims {whole:,} bytes, more than the file has; it is cut "
            "off, or damaged"
        )
    data = file.read(whole)
    if kind in {_INTS, _FLOATS}:
        return np.frombuffer(data[: whole // 8 * 8], "<i8" if kind == _INTS else "<f8")
    if kind == _BLOB:
        return data
    encoding = "latin-1" if kind == _TEXT else "utf-16-le"
    return data.decode(encoding, "replace").split("\0", 1)[0]


def head_bytes(magic: bytes, tags: Iterable[tuple[str, Any]]) -> bytes:
    """Return a head of these tags, ``Header_End`` included.

    Parameters
    ----------
    magic
        What the file is.
    tags
        Names and values: whole and real numbers, truths, texts, arrays of float64; a list makes a tag with
        indices.
    """
    parts = [magic, _VERSION]
    for name, value in tags:
        several = enumerate(value) if isinstance(value, list) else [(-1, value)]
        parts += [_tag(name, index, one) for index, one in several]
    return b"".join([*parts, _TAG.pack(b"Header_End", -1, _EMPTY, bytes(8))])


def _tag(name: str, index: int, value: Any) -> bytes:
    if isinstance(value, bool):
        kind, packed, data = _BOOL, struct.pack("<q", value), b""
    elif isinstance(value, int):
        kind, packed, data = _INT, struct.pack("<q", value), b""
    elif isinstance(value, float):
        kind, packed, data = _FLOAT, struct.pack("<d", value), b""
    elif isinstance(value, np.ndarray):
        data = value.astype("<f8").tobytes()
        kind, packed = _FLOATS, struct.pack("<q", len(data))
    else:
        text = str(value).encode("latin-1", "replace")
        data = text + bytes(8 - len(text) % 8)  # ends in a zero at least, in whole eights of bytes
        kind, packed = _TEXT, struct.pack("<q", len(data))
    return _TAG.pack(name.encode("ascii"), index, kind, packed) + data


def place_of(head: bytes, name: str) -> int:
    """Return where the value of a tag lies in a head, to put another there later."""
    return head.index(name.encode("ascii").ljust(32, b"\0")) + 40
