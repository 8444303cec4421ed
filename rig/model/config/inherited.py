"""Configuration files that extend others: all that they say together, and which file says what.

A file names those that it extends with ``extends = "lab.toml"`` or a list of paths. A path begins at the
folder of the file that says it. Tables are merged key by key. Everything else replaces what was there: a
value, a list, and the whole section of a device whose ``kind`` is another one. Of a list, later files go
before earlier ones, and what the file itself says goes before all of them.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.errors import ConfigError
from rig.model.config.kinds import ROLES
from rig.model.config.older import with_kinds
from rig.model.presets import Table, merged
from rig.model.toml import read_toml

#: The key that names the files that one extends.
EXTENDS = "extends"
#: So many files may extend one another, and so many may be named in one list.
DEEPEST, MOST_PARENTS = 10, 10
#: Where something stands in a configuration, e.g. ``("galvo", "address")``.
Place = tuple[str, ...]


@dataclass(frozen=True)
class Written:
    """What a file and all that it extends say.

    Attributes
    ----------
    table
        The content, put together.
    files
        The file of each key. Of a table, the last one that has something in it.
    first
        The first file that extends no other; paths that nobody says begin at its folder.
    """

    table: Table
    files: dict[Place, Path]
    first: Path

    def file_of(self, place: Place) -> Path:
        """Return the file in which a key stands, or else the one that has the table around it."""
        while place not in self.files:
            place = place[:-1]
        return self.files[place]


def read(path: Path) -> Written:
    """Read a file and all that it extends.

    Raises
    ------
    ConfigError
        If one is missing or is not TOML, if they extend each other in a circle or too deeply, or if
        ``extends`` is no path.
    """
    return _read(path, (), {})


def _read(path: Path, below: tuple[Path, ...], known: dict[str, Written]) -> Written:
    """Read a file that those ``below`` extend; what was read once is ``known``."""
    chain = (*below, path)
    where = os.path.realpath(path)
    if where in map(os.path.realpath, below):
        raise ConfigError(f"{_arrows(chain)}: these files extend each other in a loop; leave one out")
    if len(chain) > DEEPEST:
        raise ConfigError(f"{_arrows(chain)}: at most {DEEPEST} files may extend one another in a row")
    if where not in known:
        table = with_kinds(_table(path, below))
        names = _parents(table.pop(EXTENDS, []), path)
        known[where] = _together([_read(path.parent / name, chain, known) for name in names], table, path)
    return known[where]


def _parents(said: Any, path: Path) -> list[str]:
    names = [said] if isinstance(said, str) else said
    if not isinstance(names, list) or not all(isinstance(one, str) and one for one in names):
        raise ConfigError(f"{path}: extends: write the path of a configuration, or a list of paths")
    if len(names) > MOST_PARENTS:
        raise ConfigError(f"{path}: extends: names {len(names)} files; the limit is {MOST_PARENTS}")
    return names


def _together(parents: list[Written], table: Table, path: Path) -> Written:
    content: Table = {}
    files: dict[Place, Path] = {}
    for changes, of_changes in [*((one.table, one.files) for one in parents), (table, _all_of(table, path))]:
        replaced = [role for role in ROLES if _other_kind(role, content.get(role), changes.get(role))]
        content = merged({name: one for name, one in content.items() if name not in replaced}, changes)
        files = {place: file for place, file in files.items() if not {*place[:1]} & {*replaced}} | of_changes
    return Written(content, files, parents[0].first if parents else path)


def _other_kind(role: str, old: Any, new: Any) -> bool:
    """Return whether a device is of another kind than before; a section that does not say keeps its kind."""
    if not isinstance(old, dict) or not isinstance(new, dict) or "kind" not in new:
        return False
    return ROLES[role].kind_of(old) != ROLES[role].kind_of(new)


def _all_of(table: Table, path: Path, within: Place = ()) -> dict[Place, Path]:
    """Return the file for each key of nested tables."""
    files = {within: path}
    for name, value in table.items():
        place = (*within, name)
        files |= _all_of(value, path, place) if isinstance(value, dict) else {place: path}
    return files


def _table(path: Path, below: tuple[Path, ...]) -> Table:
    """Read a TOML file; raises as `read`."""
    remedy = f"Correct extends in {below[-1]}" if below else "Give the path of a TOML file"
    return read_toml(path, "configuration", remedy)


def _arrows(chain: tuple[Path, ...]) -> str:
    return " -> ".join(os.path.normpath(one) for one in chain)
