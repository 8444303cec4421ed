"""What all calibrations on the command line share: options, raw data, and the result."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.consent import Yes
from rig.commands.options import BUILT_IN, AsJson, Config, Seed

if TYPE_CHECKING:
    from rig.calibrate.routine import Routine
    from rig.calibrate.run import Calibrated
    from rig.model.config import RigConfig

From = Annotated[
    list[Path] | None,
    typer.Option(
        "--from", metavar="FILE", help="Fit this recorded raw data instead of measuring; repeatable."
    ),
]
Keep = Annotated[
    Path | None, typer.Option("--keep", metavar="FOLDER", help="Keep the raw data in this folder.")
]


def run(
    routine: "Routine[Any]",
    config: Config = None,
    seed: Seed = None,
    recorded: From = None,
    keep: Keep = None,
    yes: Yes = False,
    as_json: AsJson = False,
) -> None:
    """Measure or read, fit, store and tell."""
    from rig.commands import console
    from rig.commands.consent import require_consent
    from rig.model.calibrations.headlines import headline

    rig = configuration(config, seed)
    if not recorded:
        require_consent(rig, yes=yes)
    result = calibrated(routine, rig, recorded, keep, yes=yes)
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
    routine: "Routine[Any]",
    config: "RigConfig",
    recorded: list[Path] | None,
    keep: Path | None,
    *,
    yes: bool = False,
) -> "Calibrated[Any]":
    """Measure or read, fit and store; raw data stays in ``keep`` alone.

    ``yes`` answers for the person what is set by hand, but for what the routine itself asks.
    """
    from rig.acquire.acquisition import Watch
    from rig.acquire.interrupt import StopRequest
    from rig.calibrate.run import fitted, measured
    from rig.commands import console
    from rig.commands.operator import ConsoleOperator
    from rig.errors import InterruptedScanError, UsageError, reason

    if recorded:
        return fitted(routine, config, recorded)
    with TemporaryDirectory(prefix="rig-calibrate-") as temporary:
        folder = keep or Path(temporary)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            raise UsageError(
                f"--keep {folder}: cannot create this folder ({reason(problem)}); name another"
            ) from None
        with StopRequest(console.announce) as stop, console.Counting(routine.kind) as counting:
            operator = ConsoleOperator(stop, yes=yes)
            files = measured(routine, config, operator, folder, Watch([counting], stop))
        if stop():
            raise InterruptedScanError(f"{routine.kind}: stopped, nothing was stored")
        return fitted(routine, config, files)


def configuration(path: Path | None, seed: int | None) -> "RigConfig":
    """Return the rig that the options name."""
    from rig.errors import UsageError
    from rig.model.config import built_in, load

    config = load(path) if path else built_in()
    if seed is None:
        return config
    if config.simulation is None:
        raise UsageError(
            f"--seed is only for the simulated rig, but {path} has real devices; leave it out, or use "
            f"--config {BUILT_IN}"
        )
    return config.model_copy(update={"simulation": config.simulation.model_copy(update={"seed": seed})})


def _facts(content: dict[str, Any]) -> dict[str, str]:
    """Return what was found, the long lists left out."""
    from rig.model.quantities import show

    units = {"_m_per_s": "m/s", "_s": "s", "_hz": "Hz", "_m": "m", "_rad": "rad"}
    facts = {}
    for name, value in content.items():
        suffix, unit = next((one for one in units.items() if name.endswith(one[0])), ("", ""))
        label = name.removesuffix(suffix)
        if isinstance(value, float):
            facts[label.replace("_", " ")] = show(value, unit, 4) if unit else f"{value:.4g}"
        elif isinstance(value, bool):
            facts[label.replace("_", " ")] = "yes" if value else "no"
        elif isinstance(value, int):
            facts[label.replace("_", " ")] = f"{value:,}"
        elif isinstance(value, str):
            facts[label.replace("_", " ")] = value
    return facts
