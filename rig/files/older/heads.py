"""Which older file it is, by the name of its instrument and the version of its format."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rig.errors import DataFileError, printable
from rig.files.older import hydraharp, picoharp, timeharp
from rig.files.older.fields import Fields
from rig.files.picoquant import MAGIC_HISTOGRAMS, MAGIC_RECORDS, Head

_Read = Callable[[Fields, str], dict[str, Any]]
#: Versions that are read, and what reads them, by what a file begins with.
_READERS: dict[bytes, tuple[tuple[str, ...], _Read]] = {
    b"HydraHarp": (hydraharp.VERSIONS, hydraharp.read),
    b"TimeHarp 200": (timeharp.VERSIONS, timeharp.read),
    b"PicoHarp 300": (picoharp.VERSIONS, picoharp.read),
}
#: Instruments whose older files are known by name alone.
_NAMED = (b"TimeHarp", b"PicoHarp", b"NanoHarp")


def is_older(start: bytes) -> bool:
    """Return whether a file that begins so is one of PicoQuant's older ones."""
    return start.startswith((*_READERS, *_NAMED))


def read_older_head(path: Path) -> Head:
    """Read an older file's head as that of a unified file.

    Raises
    ------
    DataFileError
        If its instrument or its version is not known, or it is damaged.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(22)
        instrument, version = (_text(part) for part in (start[:16], start[16:22]))
        versions, read = _READERS.get(instrument.encode("latin-1"), ((), None))
        if read is None or version not in versions:
            known = f"of it, {' and '.join(versions)} are read" if versions else "it is not read"
            raise DataFileError(
                f"{path} is a file of {instrument} in PicoQuant's older format {version or '(none)'}; "
                f"{known}. Save or convert it as a unified file (.ptu, .phu)"
            )
        file.seek(0)
        fields = Fields(file, path, size)
        values = read(fields, version)
        if values.get("TTResultFormat_BitsPerRecord", 32) != 32:
            raise fields.damaged(f"records of {values['TTResultFormat_BitsPerRecord']} bits, which have 32")
        magic = MAGIC_RECORDS if "TTResult_NumberOfRecords" in values else MAGIC_HISTOGRAMS
        return Head(path, magic, values, fields.place, size)


def _text(raw: bytes) -> str:
    return printable(raw.split(b"\0", 1)[0].decode("latin-1").strip())
