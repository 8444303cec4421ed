"""The paper's datasets as named changes to a configuration."""

import tomllib
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from typing import Any

from rig.errors import UsageError

#: A configuration file's content, or part of it.
Table = dict[str, Any]


def about() -> dict[str, str]:
    """Return the names of all presets, and what each is."""
    return {name: table["about"] for name, table in _presets().items()}


def preset(name: str) -> Table:
    """Return the changes that a preset makes to a configuration, those of its base included.

    Raises
    ------
    UsageError
        If there is no such preset.
    """
    known = _presets()
    if name not in known:
        near = get_close_matches(name, known, n=1)
        hint = f"did you mean '{near[0]}'? " if near else ""
        raise UsageError(f"no preset '{name}'; {hint}'rig scan --preset list' shows all")
    own = dict(known[name])
    own.pop("about")
    base = own.pop("based_on", None)
    return merged(preset(base), own) if base else own


def merged(base: Table, changes: Table) -> Table:
    """Return ``base`` with ``changes`` in it, table by table."""
    result = dict(base)
    for key, value in changes.items():
        old = result.get(key)
        result[key] = merged(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return result


@cache
def _presets() -> dict[str, Table]:
    return tomllib.loads(files("rig.model").joinpath("presets.toml").read_text(encoding="utf-8"))
