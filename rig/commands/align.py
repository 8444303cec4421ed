"""``rig align``: light a spot or a circle, and show what is counted, while optics are aligned."""

import time
from math import isnan
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.consent import Yes
from rig.commands.options import AsJson, Config, Seed

if TYPE_CHECKING:
    from rig.model.config import RigConfig
    from rig.model.plan import Point, ScanPlan
    from rig.model.state import RigState
    from rig.show.levels import Levels


def align(
    config: Config = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y",
            help="Spot on the wall, e.g. 30cm,-10cm. "
            "[dim]\\[default: the scan's nearest to the middle][/dim]",
        ),
    ] = None,
    circle: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,RADIUS",
            help="Light 12 spots on a circle with this radius, one after the other, instead of one spot.",
        ),
    ] = None,
    exposure: Annotated[str, typer.Option(metavar="TIME", help="Measurement time at each spot.")] = "100ms",
    longest: Annotated[
        str, typer.Option("--for", metavar="TIME", help="The laser is switched off after this time.")
    ] = "1h",
    scene: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE", help="Hidden scene of the simulated rig. [dim]\\[default: letters][/dim]"
        ),
    ] = None,
    seed: Seed = None,
    yes: Yes = False,
    as_json: AsJson = False,
) -> None:
    """Light one spot and show live count rates and a histogram, for aligning optics and setting levels.

    Nothing is recorded. The rules for light are those of a scan: limits are checked before there is any, too
    much light ends it, and rig laser off puts it out. Ctrl-C ends it; the light goes out first.

    [bold]Examples[/bold]

      rig align                                      the simulated rig

      rig align --config lab.toml --at 30cm,-10cm    one spot

      rig align --config lab.toml --circle 0cm,0cm,20cm --exposure 50ms    round the wall's middle

    A simulated rig runs as fast as a real one here.
    """
    from rig.acquire.acquisition import Watch
    from rig.acquire.alignment import align as lit
    from rig.acquire.alignment import check_alignment, lap, laps
    from rig.acquire.interrupt import StopRequest
    from rig.commands import console
    from rig.commands.align_view import AlignmentView
    from rig.commands.consent import require_consent
    from rig.commands.operator import ConsoleOperator
    from rig.model.asked import configuration
    from rig.model.quantities import parse
    from rig.model.state import RigState
    from rig.show.levels import Levels

    state = RigState.resolve(_in_real_time(configuration(config, None, {"scene": scene, "seed": seed}, {})))
    once, longest_s = lap(_spots(at, circle, state), parse(exposure, "time")), parse(longest, "time")
    check_alignment(once, state)
    plan = laps(once, longest_s)
    if config is None:
        console.say("No configuration given: using the built-in simulated rig.")
    _warn_of_detector_spots(once, state)
    require_consent(state.config, yes=yes)
    levels = Levels(len(once))
    view, began_s = AlignmentView(levels, state, len(once)), time.monotonic()
    with StopRequest(console.say) as stop:
        watch = Watch([levels, view], stop, levels.begun)
        ended = lit(plan, state, longest_s, watch, ConsoleOperator(stop, yes=yes))
    console.say(f"Ended as asked: {ended.reason}. Nothing was recorded.")
    found = _found(levels, state)
    if as_json:
        light = view.light and {"emitting": view.light.on, "read_back": view.light.when}
        told = {
            "rig": state.config.name,
            "simulated": state.config.simulated,
            "spots_m": once.spots_m.tolist(),
            "reason": ended.reason,
            **found,
            "took_s": round(time.monotonic() - began_s, 2),
            "laser": light,
            "unverified": list(state.config.unverified),
        }
        console.print_json(told)
        return
    _print(found, levels, state, once)


def _in_real_time(config: "RigConfig") -> "RigConfig":
    """Return a configuration whose simulated bench is as fast as a real one: somebody looks at it."""
    if config.simulation is None:
        return config
    return config.model_copy(update={"simulation": config.simulation.model_copy(update={"real_time": True})})


def _spots(at: str | None, circle: str | None, state: "RigState") -> "tuple[Point, ...]":
    """Return the spots that the options ask for."""
    from rig.acquire.alignment import circle as spots_of
    from rig.acquire.alignment import usual_spot
    from rig.errors import UsageError

    if at and circle:
        raise UsageError("--at is for one spot, and --circle for many: give one of them")
    if circle:
        x_m, y_m, radius_m = _lengths(circle, "--circle", "0cm,0cm,20cm")
        return spots_of(x_m, y_m, radius_m)
    if at:
        x_m, y_m = _lengths(at, "--at", "30cm,-10cm")
        return ((x_m, y_m, 0.0),)
    return (usual_spot(state),)


def _lengths(text: str, option: str, example: str) -> list[float]:
    """Read lengths with commas between them, as many as the example has."""
    from rig.errors import UsageError
    from rig.model.quantities import parse

    parts = text.split(",")
    if len(parts) != len(example.split(",")):
        raise UsageError(
            f"'{text}' is not valid for {option}; write lengths with units, e.g. {option} {example}"
        )
    return [parse(part.strip(), "length") for part in parts]


def _warn_of_detector_spots(once: "ScanPlan", state: "RigState") -> None:
    """Warn where a scan would not measure, because the first bounce is there."""
    import numpy as np

    from rig.commands import console

    half_m = state.config.scan.skip_m / 2
    for channel in state.channels:
        away_m = np.abs(once.spots_m[:, :2] - channel.spot_m[:2]).max(axis=1).min()
        if away_m <= half_m:
            console.warn(
                f"this lights the spot that {channel.name} sees, which a scan leaves out: "
                "the detector gets the first bounce unless its gate is closed at that time"
            )
            return


def _found(levels: "Levels", state: "RigState") -> "dict[str, Any]":
    """Return what was seen, by names."""
    histogram = levels.histogram
    peak = histogram.peak(state.response_s) if histogram else None
    channels = zip(levels.names, levels.channels_hz.tolist(), strict=True)
    return {
        "sync_hz": levels.sync_hz,
        "photons": levels.photons,
        "live_time_s": levels.live_time_s,
        "last_hz": levels.now_hz,
        "mean_hz": levels.mean_hz,
        "highest_hz": levels.best_hz,
        "channels_hz": dict(channels),
        "detections_per_pulse": levels.of_pulses,
        "dark_hz": levels.dark_hz,
        "background_hz": levels.background_hz,
        "peak": peak and {"time_s": peak.time_s, "width_s": None if isnan(peak.width_s) else peak.width_s},
    }


def _print(found: "dict[str, Any]", levels: "Levels", state: "RigState", once: "ScanPlan") -> None:
    from rig.commands import console
    from rig.commands.align_view import dark_in_words, peak_in_words, spot_in_words
    from rig.model.quantities import show

    if not levels.live_time_s:
        console.say("Nothing was measured: the light went out before an exposure began.")
        return

    def rate(name: str) -> str:
        return "not known" if found[name] is None else show(found[name], "counts/s")

    first = spot_in_words(once.passes[0].positions.spots_m[0])
    console.print_facts(
        f"{state.config.name}: aligned at {first}"
        + (f" and {len(once) - 1} other spots" if len(once) > 1 else ""),
        {
            "rate at the end": rate("last_hz"),
            "highest": rate("highest_hz"),
            "mean": rate("mean_hz"),
            "sync": f"{show(levels.sync_hz, 'Hz')}, {100 * levels.of_pulses:.2g} % of it counted",
            "without light": dark_in_words(levels.dark_hz),
            "background": rate("background_hz"),
            "peak": peak_in_words(levels, state.response_s),
        },
    )
