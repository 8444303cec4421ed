"""``rig calibrate``: what the rig learns of itself. A function makes each routine, of its own options."""

from collections.abc import Callable
from enum import StrEnum
from inspect import Signature, getdoc, signature
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.calibrate_run import run
from rig.commands.options import above_zero

if TYPE_CHECKING:
    from rig.calibrate.routine import Routine

Build = Callable[..., "Routine[Any]"]


class Method(StrEnum):
    """How the steering mirror is calibrated."""

    CAMERAS = "cameras"
    FLIGHT = "flight"


calibrate = typer.Typer(
    help="Measure where the rig points, its time zero, and the properties of its detector.",
    no_args_is_help=True,
    rich_markup_mode="rich",
)
#: What makes each routine from its options, by the kind of calibration.
ROUTINES: dict[str, Build] = {}


def _routine(kind: str) -> Callable[[Build], Build]:
    """Make a command of a function that makes a routine: with its parameters, and those of all routines."""

    def add(build: Build) -> Build:
        own = signature(build).parameters
        _, *common = signature(run).parameters.values()

        def command(**options: Any) -> None:
            run(build(**{name: options.pop(name) for name in own}), **options)

        command.__signature__ = Signature([*own.values(), *common])  # type: ignore[attr-defined]
        calibrate.command(kind, help=getdoc(build))(command)
        ROUTINES[kind] = build
        return build

    return add


@_routine("galvo")
def galvo(
    method: Annotated[
        Method, typer.Option(help="With two cameras, or by times of flight and a few marks on the wall.")
    ] = Method.CAMERAS,
    columns: Annotated[int, typer.Option(min=2, max=200, help="Mirror angles along x.")] = 11,
    rows: Annotated[int, typer.Option(min=2, max=200, help="Mirror angles along y.")] = 9,
) -> "Routine[Any]":
    """Learn where the beam meets the wall for each command."""
    if method is Method.CAMERAS:
        from rig.calibrate.galvo.routine import CameraRoutine

        return CameraRoutine(columns=columns, rows=rows)
    from rig.calibrate.galvo.flight import FlightRoutine

    return FlightRoutine(columns=columns, rows=rows)


@_routine("dark")
def dark(
    exposure: Annotated[
        str | None,
        typer.Option(
            metavar="TIME", help="Exposure of each step. [dim]\\[default: 200s, uncovered 100s][/dim]"
        ),
    ] = None,
    hold_offs: Annotated[
        str,
        typer.Option(
            metavar="TIME,TIME", help="Hold-offs; none below the dead time of the timing instrument."
        ),
    ] = "90ns,120ns,160ns",
    repetition: Annotated[
        str,
        typer.Option(
            metavar="FREQUENCY",
            help="Pulses a second during this calibration, few enough to see afterpulses.",
        ),
    ] = "2MHz",
) -> "Routine[Any]":
    """Measure dark counts, ambient light and afterpulses.

    With --from: the file with the lens covered, then the one uncovered, then those with the attenuated beam.
    """
    from rig.calibrate.counting.dark import DarkRoutine

    names = ("dark_s", "ambient_s", "afterpulse_s")
    return DarkRoutine(
        hold_offs_s=tuple(above_zero("--hold-offs", text, "time") for text in hold_offs.split(",")),
        repetition_hz=above_zero("--repetition", repetition, "frequency"),
        **(dict.fromkeys(names, above_zero("--exposure", exposure, "time")) if exposure else {}),
    )


@_routine("gate")
def gate(
    nearest: Annotated[
        str, typer.Option(metavar="LENGTH", help="Distance from the wall of the nearest object to be seen.")
    ] = "50cm",
    columns: Annotated[
        int, typer.Option(min=3, max=200, help="Number of columns; the number of rows follows.")
    ] = 9,
    exposure: Annotated[
        str, typer.Option(metavar="TIME", help="Measurement time at each position and delay.")
    ] = "30ms",
    step: Annotated[str, typer.Option(metavar="TIME", help="Step between delays.")] = "200ps",
    before: Annotated[
        str, typer.Option(metavar="TIME", help="How long before the first light the sweep begins.")
    ] = "0.8ns",
    after: Annotated[
        str, typer.Option(metavar="TIME", help="How long after the last light the sweep ends.")
    ] = "1ns",
) -> "Routine[Any]":
    """Find when to open the gate: the first bounce blocked, the nearest object kept."""
    from rig.calibrate.gate.routine import GateRoutine
    from rig.model.quantities import parse

    return GateRoutine(
        nearest_m=above_zero("--nearest", nearest, "length"),
        columns=columns,
        exposure_s=above_zero("--exposure", exposure, "time"),
        step_s=above_zero("--step", step, "time"),
        before_s=parse(before, "time"),
        after_s=parse(after, "time"),
    )


@_routine("dnl")
def dnl(
    exposure: Annotated[
        str,
        typer.Option(
            metavar="TIME",
            help="Exposure of the whole measurement; the error of the widths falls with its square root.",
        ),
    ] = "20s",
) -> "Routine[Any]":
    """Measure the widths of the timing instrument's bins with uncorrelated light."""
    from rig.calibrate.counting.dnl import DnlRoutine

    return DnlRoutine(exposure_s=above_zero("--exposure", exposure, "time"))


@_routine("time-zero")
def time_zero(
    target: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Use one small target at this place in front of the wall, e.g. 10cm,-5cm,1m or 1m.",
        ),
    ] = None,
) -> "Routine[Any]":
    """Measure when the pulse is on the wall, from first bounces all over it or from one known target."""
    if target is not None:
        from rig.calibrate.timing.target import TargetRoutine, place

        return TargetRoutine(place(target))
    from rig.calibrate.timing.time_zero import TimeZeroRoutine

    return TimeZeroRoutine()


@_routine("lag")
def lag(
    rows: Annotated[int, typer.Option(min=2, max=1000, help="Rows, each scanned in both directions.")] = 6,
    point: Annotated[
        str, typer.Option(metavar="TIME", help="Time of a point, which sets the speed of the mirror.")
    ] = "1ms",
) -> "Routine[Any]":
    """Measure by how much the mirror trails its command while it moves, from first bounces there and back."""
    from rig.calibrate.timing.lag import LagRoutine

    return LagRoutine(rows=rows, point_s=above_zero("--point", point, "time"))


@_routine("irf")
def irf() -> "Routine[Any]":
    """Measure the response of laser, detector and electronics to a pulse, from first bounces."""
    from rig.calibrate.timing.irf import ResponseRoutine

    return ResponseRoutine()
