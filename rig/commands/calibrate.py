"""``rig calibrate``: what the rig learns of itself."""

from dataclasses import replace
from enum import StrEnum
from typing import Annotated

import typer

from rig.commands.calibrate_run import AsJson, Config, From, Keep, Seed, run


class Method(StrEnum):
    """How the steering mirror is calibrated."""

    CAMERAS = "cameras"
    FLIGHT = "flight"


calibrate = typer.Typer(
    help="Learn where the rig points, when it starts and what its detector adds.",
    no_args_is_help=True,
    rich_markup_mode="rich",
)


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
        from rig.calibrate.galvo.routine import CameraRoutine

        run(CameraRoutine(columns=columns, rows=rows), config, seed, recorded, keep, as_json)
    else:
        from rig.calibrate.galvo.flight import FlightRoutine

        run(FlightRoutine(columns=columns, rows=rows), config, seed, recorded, keep, as_json)


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
    from rig.calibrate.dark import DarkRoutine
    from rig.model.quantities import parse

    routine = DarkRoutine(
        hold_offs_s=tuple(parse(text, "time") for text in hold_offs.split(",")),
        repetition_hz=parse(repetition, "frequency"),
    )
    if exposure:
        each_s = parse(exposure, "time")
        routine = replace(routine, dark_s=each_s, ambient_s=each_s, afterpulse_s=each_s)
    run(routine, config, seed, recorded, keep, as_json)


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
    from rig.calibrate.gate import GateRoutine
    from rig.model.quantities import parse

    routine = GateRoutine(
        nearest_m=parse(nearest, "length"),
        columns=columns,
        exposure_s=parse(exposure, "time"),
        step_s=parse(step, "time"),
        before_s=parse(before, "time"),
        after_s=parse(after, "time"),
    )
    run(routine, config, seed, recorded, keep, as_json)


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
    from rig.calibrate.dnl import DnlRoutine
    from rig.model.quantities import parse

    run(DnlRoutine(exposure_s=parse(exposure, "time")), config, seed, recorded, keep, as_json)


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
        from rig.calibrate.target import TargetRoutine, place

        return run(TargetRoutine(place(target)), config, seed, recorded, keep, as_json)
    from rig.calibrate.time_zero import TimeZeroRoutine

    return run(TimeZeroRoutine(), config, seed, recorded, keep, as_json)


@calibrate.command("irf")
def irf(
    config: Config = None,
    seed: Seed = None,
    recorded: From = None,
    keep: Keep = None,
    as_json: AsJson = False,
) -> None:
    """Measure the response of laser, detector and electronics to a pulse, from first bounces."""
    from rig.calibrate.irf import ResponseRoutine

    run(ResponseRoutine(), config, seed, recorded, keep, as_json)
