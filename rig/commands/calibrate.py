"""``rig calibrate``: what the rig learns of itself."""

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rig.calibrating.routine import Routine
    from rig.config import RigConfig


class Method(StrEnum):
    """How the steering mirror is calibrated."""

    CAMERAS = "cameras"
    FLIGHT = "flight"


calibrate = typer.Typer(
    help="Learn where the rig points, when it starts and what its detector adds.",
    no_args_is_help=True,
    rich_markup_mode="rich",
)

Config = Annotated[
    Path | None,
    typer.Option(
        "--config", "-c", metavar="FILE", help="The rig; without it the built-in simulated rig is used."
    ),
]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed of the simulated photons. [dim]\\[0][/dim]")]
From = Annotated[
    list[Path] | None,
    typer.Option(
        "--from", metavar="FILE", help="Fit this recorded raw data instead of measuring; repeatable."
    ),
]
Keep = Annotated[
    Path | None, typer.Option("--keep", metavar="FOLDER", help="Keep the raw data in this folder.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as one JSON document.")]


@calibrate.command("galvo")
def galvo(
    config: Config = None,
    method: Annotated[
        Method,
        typer.Option(help="With two cameras, or by times of flight and a few marks on the wall."),
    ] = Method.CAMERAS,
    columns: Annotated[int, typer.Option(min=2, help="Mirror angles along x.")] = 11,
    rows: Annotated[int, typer.Option(min=2, help="Mirror angles along y.")] = 9,
    seed: Seed = None,
    recorded: From = None,
    keep: Keep = None,
    as_json: AsJson = False,
) -> None:
    """Learn where the beam meets the wall for each command."""
    if method is Method.CAMERAS:
        from rig.calibrating.galvo.routine import CameraRoutine

        _run(CameraRoutine(columns=columns, rows=rows), config, seed, recorded, keep, as_json)
    else:
        from rig.calibrating.galvo.flight_routine import FlightRoutine

        _run(FlightRoutine(columns=columns, rows=rows), config, seed, recorded, keep, as_json)


@calibrate.command("dnl")
def dnl(
    config: Config = None,
    seed: Seed = None,
    recorded: From = None,
    keep: Keep = None,
    as_json: AsJson = False,
) -> None:
    """Measure the widths of the timing instrument's bins with uncorrelated light."""
    from rig.calibrating.dnl import DnlRoutine

    _run(DnlRoutine(), config, seed, recorded, keep, as_json)


@calibrate.command("time-zero")
def time_zero(
    target: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Use one small target at this place before the wall, e.g. 10cm,-5cm,1m or 1m.",
        ),
    ] = None,
    config: Config = None,
    seed: Seed = None,
    recorded: From = None,
    keep: Keep = None,
    as_json: AsJson = False,
) -> None:
    """Measure when the pulse is on the wall, from first bounces all over it or from one known target."""
    if target is not None:
        from rig.calibrating.target import TargetRoutine, place

        return _run(TargetRoutine(place(target)), config, seed, recorded, keep, as_json)
    from rig.calibrating.time_zero import TimeZeroRoutine

    return _run(TimeZeroRoutine(), config, seed, recorded, keep, as_json)


@calibrate.command("irf")
def irf(
    config: Config = None,
    seed: Seed = None,
    recorded: From = None,
    keep: Keep = None,
    as_json: AsJson = False,
) -> None:
    """Measure the response of laser, detector and electronics to a pulse, from first bounces."""
    from rig.calibrating.irf import ResponseRoutine

    _run(ResponseRoutine(), config, seed, recorded, keep, as_json)


def _run(
    routine: "Routine",
    config_path: Path | None,
    seed: int | None,
    recorded: list[Path] | None,
    keep: Path | None,
    as_json: bool,
) -> None:
    """Measure or read, fit, store and tell."""
    from rig.commands import console

    config = _configuration(config_path, seed)
    result = _with_raw_data(keep, lambda folder: _calibrated(routine, config, recorded, folder))
    content = result.calibration.model_dump(mode="json")
    for warning in content.get("warnings", []):
        console.warn(warning)
    if as_json:
        console.print_json({"file": str(result.path), "picture": str(result.picture), "calibration": content})
        return
    console.print_facts(str(result.path), {"picture": str(result.picture), **_facts(content)})


def _calibrated(routine: "Routine", config: "RigConfig", recorded: list[Path] | None, folder: Path) -> Any:
    from rig.acquisition import Watch
    from rig.calibrating.run import fitted, measured
    from rig.commands import console
    from rig.commands.operator import ConsoleOperator
    from rig.errors import InterruptedScanError
    from rig.interrupt import StopRequest

    if recorded:
        return fitted(routine, config, recorded)
    with StopRequest(console.say) as stop:
        files = measured(routine, config, ConsoleOperator(), folder, Watch((), stop))
    if stop():
        raise InterruptedScanError(f"{routine.kind}: stopped, nothing was stored")
    return fitted(routine, config, files)


def _with_raw_data(keep: Path | None, work: Callable[[Path], Any]) -> Any:
    """Give ``work`` a folder for raw data, which stays only where it was asked for."""
    from tempfile import TemporaryDirectory

    if keep is None:
        with TemporaryDirectory(prefix="rig-calibrate-") as folder:
            return work(Path(folder))
    keep.mkdir(parents=True, exist_ok=True)
    return work(keep)


def _configuration(path: Path | None, seed: int | None) -> "RigConfig":
    from rig.config import built_in, load
    from rig.errors import UsageError

    config = load(path) if path else built_in()
    if seed is None:
        return config
    if config.simulation is None:
        raise UsageError(f"--seed is for the simulated rig, and {path} names real devices; leave it out")
    return config.model_copy(update={"simulation": config.simulation.model_copy(update={"seed": seed})})


def _facts(content: dict[str, Any]) -> dict[str, str]:
    """Return what was found, the long lists left out."""
    from rig.quantities import show

    units = {"_s": "s", "_hz": "Hz", "_m": "m", "_rad": "rad"}
    facts = {}
    for name, value in content.items():
        unit = next((unit for suffix, unit in units.items() if name.endswith(suffix)), "")
        label = name.removesuffix("_" + name.rsplit("_", 1)[-1]) if unit else name
        if isinstance(value, float):
            facts[label.replace("_", " ")] = show(value, unit, 4) if unit else f"{value:.4g}"
        elif isinstance(value, int | str):
            facts[label.replace("_", " ")] = str(value)
    return facts
