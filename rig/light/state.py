"""What is remembered of a rig's light outside of any program: who guards it now, and trips to be looked into.

All of it is in the folder ``nlos-rig`` under the user's folder for state (``XDG_STATE_HOME``), or where the
environment variable ``RIG_STATE`` says.
"""

import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import TypeVar

from rig.atomic import appearing
from rig.errors import RefusedError
from rig.model.config import RigConfig
from rig.whole import read_whole

K = TypeVar("K")


def folder() -> Path:
    """Return the folder, made if it is missing; nobody else may read it."""
    found = _place()
    found.mkdir(parents=True, exist_ok=True, mode=0o700)
    return found


def _place() -> Path:
    """Return where the folder is, or would be: what reads it needs no disk that can be written."""
    usual = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "nlos-rig"
    return Path(os.environ.get("RIG_STATE") or usual)


def key(config: RigConfig) -> str:
    """Return a name for the rig that a configuration opens: that of its laser's line.

    A served laser is another one with each server, though pseudo-terminals have the same names again.
    """
    server = getattr(config.tcspc, "address", None) or ""
    return hashlib.sha256(f"{config.light_place} {server}".encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Trip:
    """The light was lost for a reason that a person has to look into.

    Attributes
    ----------
    when
        Local time, ISO 8601.
    rig, reason
        Of which rig, and why.
    """

    when: str
    rig: str
    reason: str


def remember_trip(config: RigConfig, reason: str) -> None:
    """Keep a trip until a person acknowledges it."""
    trip = Trip(now(), config.name, reason)
    folder()
    _write(_trip_file(config), asdict(trip))


def trip_of(config: RigConfig) -> Trip | None:
    """Return the trip of this rig that nobody has acknowledged, if there is one."""
    path = _trip_file(config)
    if not os.path.lexists(path):
        return None
    return next(_read([path], Trip), Trip("at an unknown time", config.name, f"{path} cannot be read"))


def require_no_trip(config: RigConfig) -> None:
    """Raise while a trip of the rig was not acknowledged.

    Raises
    ------
    rig.errors.RefusedError
        If there is one.
    """
    if trip := trip_of(config):
        raise RefusedError(
            f"at {trip.when} the light of {trip.rig} was lost: {trip.reason.removesuffix('.')}. "
            "Go and check the rig; when all is in order, acknowledge it with: "
            "rig laser acknowledge --config FILE"
        )


def trips() -> list[Trip]:
    """Return all trips of this user's rigs that nobody has acknowledged."""
    return list(_read(sorted(_place().glob("trip-*.json")), Trip))


def forget_trip(config: RigConfig) -> None:
    """Take the trip away, because a person has acknowledged it."""
    _trip_file(config).unlink(missing_ok=True)


@dataclass(frozen=True)
class Watchman:
    """A guard that runs, and how it is reached.

    Attributes
    ----------
    pid
        Its process.
    rig, laser
        The rig's name, and the address of its laser.
    port, token
        Where it listens on this computer, and the word that it obeys.
    """

    pid: int
    rig: str
    laser: str
    port: int
    token: str


def announce(watchman: Watchman) -> Path:
    """Make a guard known; the file is to be removed by it."""
    path = folder() / f"guard-{watchman.pid}.json"
    _write(path, asdict(watchman))
    return path


def watchmen() -> list[Watchman]:
    """Return the guards that were made known; one that was killed may be among them."""
    return list(_read(sorted(_place().glob("guard-*.json")), Watchman))


def now() -> str:
    """Return the local time, to the second."""
    return datetime.now().astimezone().isoformat(timespec="seconds")


def _trip_file(config: RigConfig) -> Path:
    return _place() / f"trip-{key(config)}.json"


def _write(path: Path, content: dict[str, object]) -> None:
    with appearing(path) as partial:
        descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w") as file:
            json.dump(content, file)


def _read(paths: list[Path], kind: type[K]) -> Iterator[K]:
    for path in paths:
        with suppress(OSError, ValueError, TypeError, RecursionError):
            yield kind(**json.loads(read_whole(path)))
