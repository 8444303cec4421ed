"""``rig calibrate``: what the rig learns of itself."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rig.calibrating.routine import Routine
    from rig.config import RigConfig

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


@calibrate.command("dark")
def dark(
    config: Config = None,
    seed: Seed = None,
    recorded: From = None,
    keep: Keep = None,
    exposure: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="Exposure of each step. [dim]\\[200s, uncovered 100s][/dim]"),
    ] = None,
    hold_offs: Annotated[
        str,
        typer.Option(
            metavar="TIME,TIME", help="Hold-offs; none below the dead time of the timing instrument."
        ),
    ] = "90ns,120ns,160ns",
    repetition: Annotated[
        str,
        typer.Option(metavar="FREQUENCY", help="Pulses a second meanwhile, few enough to see afterpulses."),
    ] = "2MHz",
    as_json: AsJson = False,
) -> None:
    """Measure dark counts, ambient light and afterpulses.

    With --from: the file with the lens covered, then the one uncovered, then those with the attenuated beam.
    """
    from rig.calibrating.dark import DarkRoutine
    from rig.quantities import parse

    routine = DarkRoutine(
        hold_offs_s=tuple(parse(text, "time") for text in hold_offs.split(",")),
        repetition_hz=parse(repetition, "frequency"),
    )
    if exposure:
        each_s = parse(exposure, "time")
        routine = replace(routine, dark_s=each_s, ambient_s=each_s, afterpulse_s=each_s)
    _run(routine, config, seed, recorded, keep, as_json)


@calibrate.command("gate")
def gate(
    config: Config = None,
    seed: Seed = None,
    recorded: From = None,
    keep: Keep = None,
    nearest: Annotated[
        str, typer.Option(metavar="LENGTH", help="Distance from the wall of the nearest object to be seen.")
    ] = "50cm",
    columns: Annotated[int, typer.Option(min=3, help="Columns of the grid; as many rows as fit.")] = 9,
    exposure: Annotated[
        str, typer.Option(metavar="TIME", help="Measurement time at each position and delay.")
    ] = "30ms",
    step: Annotated[str, typer.Option(metavar="TIME", help="Between delays.")] = "200ps",
    before: Annotated[
        str, typer.Option(metavar="TIME", help="How long before the first light the sweep begins.")
    ] = "0.8ns",
    after: Annotated[
        str, typer.Option(metavar="TIME", help="How long after the last light the sweep ends.")
    ] = "1ns",
    as_json: AsJson = False,
) -> None:
    """Find when to open the gate: the first bounce blocked, the nearest object kept."""
    from rig.calibrating.gate import GateRoutine
    from rig.quantities import parse

    routine = GateRoutine(
        nearest_m=parse(nearest, "length"),
        columns=columns,
        exposure_s=parse(exposure, "time"),
        step_s=parse(step, "time"),
        before_s=parse(before, "time"),
        after_s=parse(after, "time"),
    )
    _run(routine, config, seed, recorded, keep, as_json)


@calibrate.command("dnl")
def dnl(
    config: Config = None,
    seed: Seed = None,
    recorded: From = None,
    keep: Keep = None,
    exposure: Annotated[
        str, typer.Option(metavar="TIME", help="Of the whole measurement; widths become known with its root.")
    ] = "20s",
    as_json: AsJson = False,
) -> None:
    """Measure the widths of the timing instrument's bins with uncorrelated light."""
    from rig.calibrating.dnl import DnlRoutine
    from rig.quantities import parse

    _run(DnlRoutine(exposure_s=parse(exposure, "time")), config, seed, recorded, keep, as_json)


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
