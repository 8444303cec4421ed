"""Configurations read from files and records, and what is wrong with them in words."""

import os
from difflib import get_close_matches
from pathlib import Path

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from rig.errors import ConfigError
from rig.model.config.delayers import PsdConfig
from rig.model.config.detectors import ChannelConfig
from rig.model.config.inherited import Written, read
from rig.model.config.kinds import ROLES
from rig.model.config.point_clocks import DaqClockConfig
from rig.model.config.rig import RigConfig
from rig.model.config.simulation import MotionConfig, SimulationConfig
from rig.model.presets import Table, merged
from rig.model.problems import in_words
from rig.model.quantities import FROM_RECORD

#: Wrong keys that are told at once.
MOST_TOLD = 20
#: The sections that the built-in rig has beside those that every rig has.
_BUILT_IN: Table = {"delayer": {}, "point_clock": {}, "simulation": {}}


def built_in() -> RigConfig:
    """Return the built-in simulated rig."""
    return RigConfig(delayer=PsdConfig(), point_clock=DaqClockConfig(), simulation=SimulationConfig())


def recorded(text: str) -> RigConfig:
    """Read the configuration that a scan file holds: JSON with SI numbers, from `RigConfig.model_dump_json`.

    Raises
    ------
    ConfigError
        If it does not fit this version of the program.
    """
    try:
        return RigConfig.model_validate_json(text, context=FROM_RECORD, by_alias=False, by_name=True)
    except ValidationError as error:
        raise ConfigError(explained(error)) from None


def explained(error: ValidationError) -> str:
    """Return all that is wrong with values, in a line."""
    return "; ".join(_explain(problem) for problem in error.errors())


def built_in_with(changes: Table) -> RigConfig:
    """Return the built-in simulated rig with ``changes``, written as a file's tables are.

    Raises
    ------
    ConfigError
        If a value is wrong.
    """
    return of_tables(merged(_BUILT_IN, changes))


def of_tables(tables: Table) -> RigConfig:
    """Return the configuration that a file with these tables would be.

    Raises
    ------
    ConfigError
        If a key is unknown, or a value is wrong.
    """
    try:
        return RigConfig.model_validate(tables)
    except ValidationError as error:
        raise ConfigError(explained(error)) from None


def load(path: Path, changes: Table | None = None) -> RigConfig:
    """Read a configuration file with all that it extends, and make ``changes``, written as tables are, to it.

    Where calibrations are kept begins at the folder of the file that says it, or, if none does, of the first
    file that extends no other; it is absolute afterwards.

    Raises
    ------
    ConfigError
        If a file is missing, is not TOML, or has an unknown key or a wrong value; all are named.
    """
    return resolved(read(path), changes or {})


def resolved(written: Written, changes: Table) -> RigConfig:
    """Return the configuration that files give together, with changes; raises as `load`."""
    try:
        return RigConfig.model_validate(merged(_with_folder(written), changes))
    except ValidationError as error:
        raise ConfigError(_all_of(error, written)) from None


def _with_folder(written: Written) -> Table:
    """Return the content with an absolute folder of calibrations, if what is said of it is a path at all."""
    section = written.table.get("calibration", {})
    folder = section.get("folder", "calibrations") if isinstance(section, dict) else None
    if not isinstance(folder, str) or not folder:
        return written.table
    said = ("calibration", "folder") in written.files
    file = written.file_of(("calibration", "folder")) if said else written.first
    return merged(written.table, {"calibration": {"folder": os.path.abspath(file.parent / folder)}})


def _all_of(error: ValidationError, written: Written) -> str:
    """Return what is wrong, a line for each key, the first `MOST_TOLD` of them."""
    told = [f"{written.file_of(_place(problem))}: {_explain(problem)}" for problem in error.errors()]
    more = [f"and {len(told) - MOST_TOLD} more"] if len(told) > MOST_TOLD else []
    return "\n".join(told[:MOST_TOLD] + more)


def _place(problem: ErrorDetails) -> tuple[str, ...]:
    """Return where in a file a wrong value stands: without the kind that was chosen, and numbers of lists."""
    place = problem["loc"]
    parts = [part for before, part in zip(("", *place), place, strict=False) if not _is_kind(before, part)]
    return tuple(part for part in parts if isinstance(part, str))


def _explain(problem: ErrorDetails) -> str:
    place = problem["loc"]
    parts = [part for before, part in zip(("", *place), place, strict=False) if not _is_kind(before, part)]
    where = ".".join(str(part) for part in parts)
    if problem["type"] == "extra_forbidden":
        if owners := _kinds_with(place):
            return (
                f"'{where}' is a key of kind {' or '.join(owners)}; this {place[0]} is of kind "
                f"'{place[1]}', which has {', '.join(_known_keys(place[:-1]))}"
            )
        near = get_close_matches(str(place[-1]), _known_keys(place[:-1]), n=1)
        return f"unknown key '{where}'" + (f"; did you mean '{near[0]}'?" if near else "")
    message = in_words(problem)
    return f"{where}: {message}" if where else message


def _is_kind(section: str | int, part: str | int) -> bool:
    return section in ROLES and part in ROLES[str(section)].kinds


def _kinds_with(place: tuple[str | int, ...]) -> list[str]:
    """Return the other kinds of a section of which a key is, quoted."""
    if len(place) != 3 or not _is_kind(place[0], place[1]):
        return []
    return [f"'{kind}'" for kind in ROLES[str(place[0])].kinds if place[2] in _known_keys((place[0], kind))]


def _known_keys(place: tuple[str | int, ...]) -> list[str]:
    model: type[BaseModel] = RigConfig
    for before, part in zip(("", *place), place, strict=False):
        if isinstance(part, int):
            continue
        if part in _SECTIONS:
            model = _SECTIONS[part]
        elif part in ROLES:
            model = ROLES[part].usual
        elif _is_kind(before, part):
            model = ROLES[str(before)].kinds[part]
        else:
            model = model.model_fields[part].annotation  # type: ignore[assignment]
    return [field.alias or name for name, field in model.model_fields.items()]


#: Sections whose type is not simply that of their field.
_SECTIONS: dict[str, type[BaseModel]] = {
    "simulation": SimulationConfig,
    "motion": MotionConfig,
    "channels": ChannelConfig,
}
