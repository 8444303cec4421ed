"""What is asked of a scan, as a person writes it: options' names and texts, or numbers in SI units."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rig.errors import UsageError
from rig.model import UNTIL_STOPPED
from rig.model.config import RigConfig, built_in_with, load
from rig.model.config.reading import of_tables
from rig.model.plan import FIRST_FRAMES, ScanPlan
from rig.model.presets import merged
from rig.model.presets import preset as changes_of
from rig.model.quantities import si

#: Columns and rows: text, e.g. ``"180x130"``, or two numbers.
GridSize = str | tuple[int, int]
#: A raster's lines alternate in direction, which a plan calls a snake.
_ORDERS = {"raster": "snake"}
_MODES = ("step", "continuous")


def configuration(
    source: str | Path | Mapping[str, Any] | None,
    preset: str | None = None,
    simulation: Mapping[str, object] | None = None,
    notes: Mapping[str, str | None] | None = None,
) -> RigConfig:
    """Return a rig's configuration with what was asked beside it.

    Parameters
    ----------
    source
        A configuration file, or its tables, in which quantities are text as in the file; None is the
        built-in simulated rig.
    preset
        A dataset of the paper, for the simulated rig.
    simulation, notes
        Keys of the sections ``simulation`` and ``notes``; a value of None asks nothing.

    Raises
    ------
    rig.errors.ConfigError
        If the configuration is missing or wrong.
    rig.errors.UsageError
        If something that is for the simulated rig alone is asked of a real one.
    """
    overlay = changes_of(preset) if preset else {}
    given = {name: value for name, value in (simulation or {}).items() if value is not None}
    said = {name: text for name, text in (notes or {}).items() if text is not None}
    source = Path(source) if isinstance(source, str) else source
    if source is not None and (preset or given) and not _read(source, {}).simulated:
        option = "preset" if preset else next(iter(given))
        named = source if isinstance(source, Path) else "the configuration"
        raise UsageError(
            f"--{option} is only for the simulated rig, but {named} has real devices; leave it out, or use "
            "--config simulated"
        )
    changes = merged(overlay, {"simulation": given} if given else {})
    changes = merged(changes, {"notes": said} if said else {})
    return _with_digest(built_in_with(changes) if source is None else _read(source, changes))


def _with_digest(config: RigConfig) -> RigConfig:
    """Return a configuration that says which mesh is its scene; a file that is missing is told later."""
    simulation = config.simulation
    if simulation is None or simulation.mesh is None or simulation.mesh_sha256:
        return config
    try:
        if not simulation.mesh.is_file():
            return config
        with simulation.mesh.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return config
    return config.model_copy(update={"simulation": simulation.model_copy(update={"mesh_sha256": digest})})


def placement(
    place: str | tuple[float, float, float] | None,
    rotate: str | tuple[float, float, float] | None,
    scale: float | None,
) -> dict[str, object]:
    """Return where a mesh is put, as the section ``simulation`` has it; None asks nothing.

    Parameters
    ----------
    place
        Of its middle: x, y and z, ``"0cm,0cm,1.2m"``, or three numbers in metres.
    rotate
        About x, y and z, ``"0deg,90deg,0deg"``, or three numbers in radians.
    scale
        By which its file's coordinates are multiplied.

    Raises
    ------
    rig.errors.UsageError
        If one is not three quantities.
    """
    return {
        "place": _three(place, "m", "--place 0cm,0cm,1.2m"),
        "rotate": _three(rotate, "rad", "--rotate 0deg,90deg,0deg"),
        "scale": scale,
    }


def _three(value: str | tuple[float, float, float] | None, unit: str, example: str) -> list[str] | None:
    """Return three quantities as a configuration has them."""
    if value is None:
        return None
    parts = value.split(",") if isinstance(value, str) else [f"{one!r}{unit}" for one in value]
    if len(parts) != 3:
        raise UsageError(f"'{value}' is not three quantities; write those of x, y and z, e.g. {example}")
    return [part.strip() for part in parts]


def _read(source: Path | Mapping[str, Any], changes: dict[str, Any]) -> RigConfig:
    return load(source, changes) if isinstance(source, Path) else of_tables(merged(dict(source), changes))


def plan(
    config: RigConfig,
    *,
    exposure: str | float | None = None,
    grid: GridSize | None = None,
    spacing: str | float | None = None,
    mode: str = "step",
    frames: str | int | None = None,
    order: str = "raster",
) -> ScanPlan:
    """Return a configuration's scan with what was asked of it; the names are the options of `rig scan`.

    Raises
    ------
    rig.errors.UsageError
        If something cannot be understood, or is none that a plan can have.
    """
    if mode not in _MODES:
        raise UsageError(f"there is no mode {mode!r}; choose {' or '.join(_MODES)}")
    columns, rows = columns_and_rows(grid) if grid else (None, None)
    return ScanPlan.grid(
        config,
        columns=columns,
        rows=rows,
        spacing_m=si(spacing, "length"),
        exposure_s=si(exposure, "time"),
        order=_ORDERS.get(order, order),
        motion=mode,
        **_frames(frames, mode),
    )


def columns_and_rows(grid: GridSize) -> tuple[int, int]:
    """Read a grid like 180x130.

    Raises
    ------
    rig.errors.UsageError
        If it is none.
    """
    text = grid if isinstance(grid, str) else "x".join(map(str, grid))
    columns, separator, rows = text.lower().partition("x")
    numbers = [text.strip() for text in (columns, rows)]
    plain = all(number.isascii() and number.isdecimal() and len(number) < 10 for number in numbers)
    if not (separator and plain and min(map(int, numbers)) > 1):
        raise UsageError(
            f"'{text}' is not a grid; write columns and rows, each at least 2, e.g. --grid 180x130"
        )
    return int(numbers[0]), int(numbers[1])


def _frames(asked: str | int | None, mode: str) -> dict[str, object]:
    """Read how many frames are asked for, as the plan has it."""
    if asked is None:
        return {}
    text = str(asked)
    if text.strip() != UNTIL_STOPPED:
        if not (text.isascii() and text.isdecimal() and len(text) < 10 and int(text) > 0):
            raise UsageError(
                f"'{text}' is not a number of frames; write a number from 1 on, e.g. --frames 10, or "
                f"--frames {UNTIL_STOPPED}"
            )
        return {"frames": int(text)}
    if mode != "continuous":
        raise UsageError(
            f"--frames {UNTIL_STOPPED} needs --mode continuous; add it, or give a number of frames"
        )
    return {"frames": FIRST_FRAMES, "until_stopped": True}
