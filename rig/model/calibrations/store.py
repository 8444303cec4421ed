"""The folder in which calibrations are kept: a dated JSON file for each, and its arrays beside it."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from math import isfinite
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from rig.atomic import appearing
from rig.errors import DataFileError, UsageError, reason
from rig.model.calibrations.base import Calibration, digest, digest_of_array, utc_now
from rig.model.calibrations.kinds import KINDS
from rig.model.npz import read_npz
from rig.whole import read_whole

#: Room for a calibration with its arrays and its picture.
ROOM_BYTES = 2**20


@dataclass(frozen=True)
class Stored:
    """A calibration and the file that holds it."""

    path: Path
    calibration: Calibration


class CalibrationStore:
    """All calibrations of one folder; the newest of a kind counts.

    Parameters
    ----------
    folder
        It need not exist before the first `add`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._stored: dict[Path, Stored] = {}

    def add(self, calibration: Calibration) -> Path:
        """Store a calibration in a new file, whole or not at all, and return its path.

        Raises
        ------
        UsageError
            If the folder cannot be written.
        """
        with self._storing():
            self.folder.mkdir(parents=True, exist_ok=True)
            path = self.path_for(calibration, ".json")
            if calibration.bulky:
                with appearing(path.with_suffix(".npz")) as temporary:
                    np.savez_compressed(temporary, **calibration.arrays())  # type: ignore[arg-type]
            with appearing(path) as temporary:
                temporary.write_text(calibration.document() + "\n", encoding="utf-8")
        return path

    def require_room(self) -> None:
        """Refuse before it is measured what could not be stored.

        Raises
        ------
        UsageError
            If the folder cannot be written, or there is no room.
        """
        with self._storing():
            there = next(one for one in (self.folder, *self.folder.absolute().parents) if one.exists())
            with TemporaryFile(dir=there) as tried:
                tried.write(bytes(ROOM_BYTES))

    @contextmanager
    def _storing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise UsageError(
                f"{self.folder}: the calibration cannot be stored ({reason(error)}). Free space there, or "
                "name another folder as calibration.folder"
            ) from None

    def path_for(self, calibration: Calibration, ending: str) -> Path:
        """Return where something that belongs to a calibration is kept."""
        return self.folder / f"{calibration.kind}-{calibration.created:%Y%m%dT%H%M%SZ}{ending}"

    def newest(
        self, kind: str, identities: dict[str, str] | None = None, rig_name: str | None = None
    ) -> Stored | None:
        """Return the newest calibration of a kind; of these devices, and of a rig of this name, where given.

        One that is dated in the future counts only where there is no other: else it would be the newest for
        ever.

        Raises
        ------
        DataFileError
            If a file of this kind is damaged; older ones are not read.
        """
        in_future = None
        now = utc_now()
        for path in sorted(self.folder.glob(f"{kind}-*.json"), reverse=True):  # the names carry the date
            one = self._read(path)
            of_rig = rig_name in {None, one.calibration.rig_name}
            if of_rig and not one.calibration.strangers(identities or {}):
                if not one.calibration.is_from_the_future(now):
                    return one
                in_future = in_future or one
        return in_future

    def from_the_future(self, kind: str, rig_name: str) -> list[Path]:
        """Return the files of a kind and rig that are dated in the future; raises as `newest`."""
        found, now = [], utc_now()
        for path in sorted(self.folder.glob(f"{kind}-*.json"), reverse=True):
            one = self._read(path).calibration
            if not one.is_from_the_future(now):
                break
            if one.rig_name == rig_name:
                found.append(path)
        return found

    def everything(self) -> Iterator[Stored]:
        """Return all calibrations, kind by kind, the oldest first.

        Raises
        ------
        DataFileError
            If a file is damaged.
        """
        for kind in KINDS:
            yield from map(self._read, sorted(self.folder.glob(f"{kind}-*.json")))

    def _read(self, path: Path) -> Stored:
        """Return a stored calibration; a file is never changed once it is there, so it is read once."""
        if path not in self._stored:
            self._stored[path] = Stored(path, read(path))
        return self._stored[path]


def read(path: Path) -> Calibration:
    """Read a stored calibration.

    Raises
    ------
    DataFileError
        If it cannot be read, is of an unknown kind, or was changed after it was stored.
    """
    try:
        return parse(read_whole(path).decode(), _arrays_beside(path))
    except OSError as error:
        raise DataFileError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise DataFileError(f"{path}: {error}. Move it away, or measure it again: rig calibrate") from None


def _arrays_beside(path: Path) -> dict[str, NDArray]:
    """Return the arrays that are kept beside a calibration's text; raises as `read`."""
    beside = path.with_suffix(".npz")
    if not beside.is_file():
        return {}
    try:
        return read_npz(beside)
    except ValueError as error:
        raise DataFileError(f"{beside} is damaged: {error}. Measure it again: rig calibrate") from None


def parse(text: str, arrays: Mapping[str, NDArray] | None = None) -> Calibration:
    """Read a calibration's JSON text, and the arrays that it names.

    Raises
    ------
    ValueError
        If it is none, or was changed after it was stored.
    """
    try:
        content = json.loads(text, parse_float=_finite, parse_constant=_finite)
        kind, stored = content["kind"], content.pop("digest")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise ValueError("it is not a calibration") from None
    if digest(content) != stored:
        raise ValueError("it was changed after it was stored: its digest does not match")
    if not isinstance(kind, str) or kind not in KINDS:
        raise ValueError(f"it is of the unknown kind '{kind}', perhaps of a newer version of this program")
    del content["kind"]
    named = content.pop("arrays", {})
    if not isinstance(named, dict):
        raise ValueError("it does not match this version of the program (arrays)")
    for name, wanted in named.items():
        array = (arrays or {}).get(name)
        if array is None or digest_of_array(array) != wanted:
            raise ValueError(f"its array '{name}' is missing, or differs")
        content[name] = [None if np.isnan(one) else one for one in array.tolist()]
    try:
        return KINDS[kind].model_validate(content)
    except ValidationError as error:
        where = ", ".join(".".join(map(str, problem["loc"])) for problem in error.errors())
        raise ValueError(f"it does not match this version of the program ({where})") from None


def _finite(text: str) -> float:
    """Read a number; raise ValueError where it is too large for one, or none."""
    value = float(text)
    if not isfinite(value):
        raise ValueError(f"{text[:20]} is not a finite number")
    return value


def doubts(calibration: Calibration, now: datetime | None = None) -> str:
    """Return what speaks against using a calibration, as a sentence; empty where nothing does."""
    now = now or utc_now()
    if calibration.is_from_the_future(now):
        return (
            f"the {calibration.kind} calibration is dated {calibration.created:%Y-%m-%d}, in the future: set "
            f"this computer's clock, or measure it again with rig calibrate {calibration.kind}"
        )
    if not calibration.is_old(now):
        return ""
    days = (now - calibration.created).total_seconds() / 86400
    return (
        f"the {calibration.kind} calibration is {days:.0f} days old, and was valid for "
        f"{calibration.valid_days:g} days: measure it again with rig calibrate {calibration.kind}"
    )
