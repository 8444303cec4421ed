"""The scans of a folder, each told in a line; only what they say beside their photons is read."""

import os
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rig.errors import ConfigError, DataFileError
from rig.files.check import plain, reading
from rig.files.inspection import inspect_all
from rig.files.journal import journal_of
from rig.files.opened import hdf5_file
from rig.files.outline import ScanOutline
from rig.model.quantities import show
from rig.show.about import scan_document

#: Titles of the columns of `Entry.row`.
HEADER = ("date", "scan", "positions", "exposure", "photons", "status", "purpose")
_ENDINGS = {".h5", ".hdf5"}


@dataclass(frozen=True)
class Entry:
    """A scan file of a folder.

    Attributes
    ----------
    path
        Where it is.
    document
        What it says, as `rig.show.about.scan_document` has it; empty where it cannot be read.
    problem
        Why it cannot be read; empty if it can.
    """

    path: Path
    document: dict[str, Any]
    problem: str = ""

    @property
    def order(self) -> tuple[str, str]:
        """By date, the newest last; what has none goes by the date of its file."""
        return self.date, self.path.name

    @property
    def date(self) -> str:
        """When the scan was begun, UTC; of a damaged file, when it was last written."""
        return str(self.document.get("created") or "") or _written(self.path)

    def row(self) -> tuple[str, ...]:
        """Return what a line of a table says, as `HEADER` names it."""
        date = self.date[:16].replace("T", " ")
        if self.problem:
            return date, self.path.name, "", "", "", "damaged", self.problem
        found = self.document
        measured, planned = found["measured"], found["positions"]
        exposures = sorted({one["exposure_s"] for one in found["plan"] or ()})
        each_s = exposures or ([found["live_time_s"] / measured] if measured and found["live_time_s"] else [])
        said = found["notes"].get("purpose") or found["notes"].get("note", "")
        return (
            date,
            self.path.name,
            f"{measured:,}" if measured == planned else f"{measured:,} of {planned:,}",
            ", ".join(show(one, "s") for one in each_s[:3]),
            "" if found["photons"] is None else f"{found['photons']:,}",
            found["status"],
            " ".join(str(said).split()),
        )


def catalogue(folder: Path) -> list[Entry]:
    """Return the scans of a folder, the newest last; files that are no scans are passed over.

    A file that ends as ours do and is no HDF5 file, or a scan that cannot be read, is told as damaged.

    Raises
    ------
    DataFileError
        If there is no such folder, or it cannot be read.
    """
    try:
        names = sorted(os.listdir(folder))
    except OSError as error:
        raise DataFileError(f"{folder}: {error.strerror}; give the name of a folder with scans") from None
    every = dict.fromkeys(folder / name.removesuffix(".journal") for name in names)
    paths = [path for path in every if path.suffix.lower() in _ENDINGS]
    inspect_all(paths)
    found = [_entry(path) for path in paths]
    return sorted((one for one in found if one is not None), key=lambda one: one.order)


def _entry(path: Path) -> Entry | None:
    """Return what a file says of itself; None where it is no scan."""
    try:
        if not os.path.exists(journal_of(path)) and not _is_scan(path):
            return None
        with ScanOutline(path) as scan, reading(path):
            return Entry(path, scan_document(scan))
    except (DataFileError, ConfigError) as error:
        return Entry(path, {}, " ".join(str(error).removeprefix(f"{path} ").split()))


def _is_scan(path: Path) -> bool:
    """Return whether a file says that it is a scan, or is so damaged that it may have been one."""
    if not path.is_file():
        return False
    try:
        with hdf5_file(path, "r") as file:
            return bool(plain(file.attrs.get("format")) == "rig-scan")
    except (OSError, RuntimeError, ValueError, KeyError, TypeError):
        return True


def _written(path: Path) -> str:
    try:
        return datetime.fromtimestamp(path.stat().st_mtime, UTC).isoformat(timespec="seconds")
    except OSError:
        return ""
