"""What all calibrations on the command line share: options, raw data, and the result."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rig.calibrate.routine import Routine
    from rig.calibrate.run import Calibrated
    from rig.model.config import RigConfig

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


def run(
    routine: "Routine",
    config_path: Path | None,
    seed: int | None,
    recorded: list[Path] | None,
    keep: Path | None,
    as_json: bool,
) -> None:
    """Measure or read, fit, store and tell."""
    from rig.commands import console
    from rig.model.calibrations.headlines import headline

    config = configuration(config_path, seed)
    result = calibrated(routine, config, recorded, keep)
    content = result.calibration.model_dump(mode="json")
    for warning in content.get("warnings", []):
        console.warn(warning)
    if as_json:
        console.print_json({"file": str(result.path), "picture": str(result.picture), "calibration": content})
        return
    console.print_facts(
        str(result.path),
        {"found": headline(result.calibration), "picture": str(result.picture), **_facts(content)},
    )


def calibrated(
    routine: "Routine", config: "RigConfig", recorded: list[Path] | None, keep: Path | None
) -> "Calibrated":
    """Measure or read, fit and store; raw data stays in ``keep`` alone."""
    return _with_raw_data(keep, lambda folder: _calibrated(routine, config, recorded, folder))


def _calibrated(
    routine: "Routine", config: "RigConfig", recorded: list[Path] | None, folder: Path
) -> "Calibrated":
    from rig.acquire.acquisition import Watch
    from rig.acquire.interrupt import StopRequest
    from rig.calibrate.run import fitted, measured
    from rig.commands import console
    from rig.commands.operator import ConsoleOperator
    from rig.errors import InterruptedScanError

    if recorded:
        return fitted(routine, config, recorded)
    with StopRequest(console.say) as stop, console.Counting(routine.kind) as counting:
        files = measured(routine, config, ConsoleOperator(), folder, Watch([counting], stop))
    if stop():
        raise InterruptedScanError(f"{routine.kind}: stopped, nothing was stored")
    return fitted(routine, config, files)


def _with_raw_data(keep: Path | None, work: "Callable[[Path], Calibrated]") -> "Calibrated":
    """Give ``work`` a folder for raw data, which stays only where it was asked for."""
    from tempfile import TemporaryDirectory

    if keep is None:
        with TemporaryDirectory(prefix="rig-calibrate-") as folder:
            return work(Path(folder))
    keep.mkdir(parents=True, exist_ok=True)
    return work(keep)


def configuration(path: Path | None, seed: int | None) -> "RigConfig":
    """Return the rig that the options name."""
    from rig.errors import UsageError
    from rig.model.config import built_in, load

    config = load(path) if path else built_in()
    if seed is None:
        return config
    if config.simulation is None:
        raise UsageError(f"--seed is for the simulated rig, and {path} names real devices; leave it out")
    return config.model_copy(update={"simulation": config.simulation.model_copy(update={"seed": seed})})


def _facts(content: dict[str, Any]) -> dict[str, str]:
    """Return what was found, the long lists left out."""
    from rig.model.quantities import show

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
