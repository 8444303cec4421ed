"""Many images, written down: a TOML file of scans, and of settings whose lists are multiplied."""

import hashlib
import json
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

import rig
from rig.cluster.tasks import fingerprint
from rig.errors import ConfigError, UsageError
from rig.image.asked import OPTIONS, Option
from rig.image.request import Request
from rig.model.toml import read_toml

#: Settings by the names of the options of ``rig recon``. A folder of calibrations changes without its name,
#: so that nobody could say whether an image is still of them.
SETTINGS = {
    name.replace("_", "-"): option
    for name, option in OPTIONS.items()
    if name not in {"calibrations", "however_long"}
}
#: Images of one batch: each takes memory, and is looked for before the first is made.
MOST_IMAGES = 100_000


@dataclass(frozen=True)
class Job:
    """One image.

    Attributes
    ----------
    name
        Of its files: the scan's, and what was varied.
    scan
        What is imaged.
    settings
        As they were written.
    request
        The same, read.
    """

    name: str
    scan: Path
    settings: Mapping[str, Any]
    request: Request

    @property
    def key(self) -> str:
        """What tells it from the same name with another scan, other settings or another version."""
        what = [str(self.scan), fingerprint(self.scan), dict(self.settings), rig.__version__]
        return hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()[:24]

    def files(self, folder: Path) -> tuple[Path, Path]:
        """Return where its volume and its picture go."""
        return folder / f"{self.name}-volume.h5", folder / f"{self.name}.png"


def read_jobs(path: Path, however_long: bool = False) -> list[Job]:
    """Read a file of jobs.

    Parameters
    ----------
    path
        The file; scans are named relative to it.
    however_long
        Whether images that take long are computed, too.

    Raises
    ------
    ConfigError
        If it is missing, no TOML, or has a wrong key or value, or names no scan, or two images alike.
    """
    document = read_toml(path, "list of jobs", "See docs/cluster.md for an example")
    tables = document.pop("job", None)
    listed = isinstance(tables, list) and tables and all(isinstance(one, dict) for one in tables)
    if document or not listed:
        wrong = f"it has the key {', '.join(document)}" if document else "it has none"
        raise ConfigError(f"{path} must hold only tables [[job]], but {wrong}; see docs/cluster.md")
    jobs: list[Job] = []
    for number, table in enumerate(tables, 1):
        jobs += _of_table(path, f"{path}, job {number}", table, MOST_IMAGES - len(jobs), however_long)
    if twice := sorted(name for name, many in Counter(job.name for job in jobs).items() if many > 1):
        raise ConfigError(
            f"{path}: {len(twice)} images would have the name of another image; the first is {twice[0]}; "
            "name the "
            "scans differently, or each scan and setting once"
        )
    return jobs


def _of_table(path: Path, where: str, table: Mapping[str, Any], most: int, however_long: bool) -> list[Job]:
    if unknown := sorted(set(table) - {*SETTINGS, "scans"}):
        raise ConfigError(
            f"{where}: unknown key {', '.join(unknown)}; known are scans, {', '.join(SETTINGS)}"
        )
    scans = _scans(path, where, table.get("scans"))
    lists = {
        key: value if isinstance(value, list) else [value] for key, value in table.items() if key != "scans"
    }
    if empty := [key for key, values in lists.items() if not values]:
        raise ConfigError(f"{where}: {', '.join(empty)} is an empty list; leave it out")
    if (images := len(scans) * prod(len(values) for values in lists.values())) > most:
        raise ConfigError(
            f"{where}: asks for {images:.6g} images, and a batch has at most {MOST_IMAGES:,} of all its "
            "jobs; name fewer scans or values, or make several lists"
        )
    varied = [key for key, values in lists.items() if len(values) > 1]
    jobs = []
    for scan in scans:
        for values in product(*lists.values()):
            settings = dict(zip(lists, values, strict=True))
            name = "-".join([scan.stem, *(f"{key}={_in_a_name(settings[key])}" for key in varied)])
            jobs.append(Job(name, scan, settings, _request(where, settings, however_long)))
    return jobs


def _scans(path: Path, where: str, patterns: Any) -> list[Path]:
    patterns = [patterns] if isinstance(patterns, str) else patterns
    if not isinstance(patterns, list) or not patterns or not all(isinstance(one, str) for one in patterns):
        raise ConfigError(f'{where}: scans must be a list of names or patterns, such as ["night/*.h5"]')
    found: dict[Path, None] = {}
    for pattern in patterns:
        root = Path(Path(pattern).anchor or path.parent)
        try:
            rest = pattern.removeprefix(Path(pattern).anchor)
            matches = sorted(one.resolve() for one in root.glob(rest) if one.is_file())
        except (ValueError, NotImplementedError, IndexError, OSError) as error:
            raise ConfigError(f"{where}: '{pattern}' is not a pattern of file names: {error}") from None
        if not matches:
            raise ConfigError(f"{where}: no file is called '{pattern}', seen from {root.resolve()}")
        found |= dict.fromkeys(matches)
    return list(found)


def _request(where: str, settings: Mapping[str, Any], however_long: bool) -> Request:
    """Read settings one by one, so that an error names the one that is wrong."""
    fields: dict[str, Any] = {"however_long": however_long}
    for key, value in settings.items():
        option = SETTINGS[key]
        try:
            _check_form(option, value)
            fields[option.field] = option.read(value)
        except UsageError as error:
            raise ConfigError(f"{where}: {key}: {error}") from None
    return Request(**fields)


def _check_form(option: Option, value: Any) -> None:
    """Refuse a value that is not written as its option is."""
    wrong = {
        "text": not isinstance(value, str) or not value,
        "number": isinstance(value, bool) or not isinstance(value, int | float),
        "switch": not isinstance(value, bool),
        "word": value not in option.words,
    }
    said = {
        "text": "must be text with a unit, in quotes",
        "number": "is not a number",
        "switch": "is neither true nor false",
        "word": f"is not one of {', '.join(option.words)}",
    }
    if wrong[option.form]:
        raise UsageError(f"{value!r} {said[option.form]}")


def _in_a_name(value: Any) -> str:
    """Return a value as a part of a file's name."""
    return re.sub(r"[^\w.+=-]", "_", str(value).lower() if isinstance(value, bool) else str(value))
