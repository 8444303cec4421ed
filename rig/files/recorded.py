"""What all files of measurements say of where they come from."""

import hashlib
import json
from abc import ABC, abstractmethod
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import h5py

from rig.errors import ConfigError, DataFileError
from rig.files.check import open_hdf5, plain, reading
from rig.files.description import Settings
from rig.model.config import RigConfig
from rig.model.config import recorded as recorded_config


class RecordedFile(ABC):
    """An open file of measurements; use as a context manager.

    Attributes
    ----------
    path
        Where it is.
    digested
        The file whose bytes `digest` is made of.

    Raises
    ------
    DataFileError
        If the file is missing, truncated, foreign, or lacks what is needed.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.digested = self.path
        self._file = self._open()
        try:
            with reading(self.path):
                self._read()
        except BaseException:
            self._file.close()
            raise

    def _open(self) -> h5py.File:
        return open_hdf5(self.path)

    @abstractmethod
    def _read(self) -> None:
        """Check the format, and read what is always wanted."""

    @cached_property
    def config(self) -> RigConfig | None:
        """The configuration; None where the file does not say.

        Raises
        ------
        DataFileError
            If it is damaged, or of a newer program.
        """
        text = str(self._attribute("start", "configuration", "{}"))
        try:
            return None if text == "{}" else recorded_config(text)
        except ConfigError as error:
            raise DataFileError(f"{self.path}: its configuration cannot be read: {error}") from None

    @property
    def simulated(self) -> bool:
        """Whether it was computed rather than measured."""
        return bool(self._attribute("start", "simulated", False))

    @property
    def created(self) -> str:
        """When the file was created, UTC, ISO 8601; empty where the file does not say."""
        return str(self._attribute("/", "created", ""))

    @property
    def software(self) -> str:
        """What wrote the file; empty where the file does not say."""
        return str(self._attribute("/", "software", ""))

    @property
    def command(self) -> str:
        """The command that made the file; empty where the file does not say."""
        return str(self._attribute("start", "command", ""))

    @property
    def devices(self) -> dict[str, Settings]:
        """Settings of each device, ``identity`` among them."""
        groups = self._file.get("devices", {})
        with reading(self.path):
            return {
                name: {key: plain(value) for key, value in group.attrs.items() if key != "description"}
                for name, group in groups.items()
            }

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the file's bytes, hexadecimal."""
        return digest_of_file(self.digested)

    @property
    def is_open(self) -> bool:
        """Whether it can be read."""
        return bool(self._file)

    def close(self) -> None:
        """Close the file; what is read later can no longer be read."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _json(self, group: str, name: str, default: str, kind: type) -> Any:
        """Return what an attribute holds as JSON, which must be of this kind."""
        try:
            found = json.loads(self._attribute(group, name, default))
        except (ValueError, TypeError, RecursionError) as error:
            raise DataFileError(f"{self.path}: /{group}@{name} is not JSON: {error}") from None
        if not isinstance(found, kind):
            raise DataFileError(f"{self.path}: /{group}@{name} is not a JSON {kind.__name__}; it is damaged")
        return found

    def _attribute(self, group: str, name: str, default: Any) -> Any:
        with reading(self.path):
            owner: h5py.Group | None = self._file.get(group)
            return default if owner is None else plain(owner.attrs.get(name, default))


def digest_of_file(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
