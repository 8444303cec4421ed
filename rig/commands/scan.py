"""``rig scan``: measure the relay wall."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands import completing
from rig.commands.consent import Yes
from rig.commands.options import (
    MEANWHILE,
    RESULTS,
    AsJson,
    Config,
    Frames,
    Grid,
    Live,
    Mode,
    Note,
    Operator,
    Order,
    Place,
    Ptu,
    Purpose,
    Rotate,
    Sample,
    Scale,
    Seed,
    Spacing,
    Until,
    Web,
)
from rig.commands.results import require_free

if TYPE_CHECKING:
    from rig.acquire.preflight import Estimate
    from rig.model.plan import Grid as GridPositions
    from rig.model.plan import ScanPlan
    from rig.model.state import RigState


def scan(
    config: Config = None,
    exposure: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="Measurement time at each position. [dim]\\[default: 10ms][/dim]"),
    ] = None,
    grid: Grid = None,
    spacing: Spacing = None,
    mode: Annotated[
        Mode,
        typer.Option(
            help="step: the mirror rests at each position. continuous: it never stops along a line, and each "
            "photon is recorded with its time; much faster for short exposures."
        ),
    ] = Mode.STEP,
    frames: Frames = None,
    order: Annotated[
        Order,
        Place,
        typer.Option(
            help="raster: line by line, in alternating directions. unidirectional: "
            "all lines in the same direction. progressive: coarse to fine, the whole wall in each round. "
            "random: random order."
        ),
    ] = Order.RASTER,
    until: Until = None,
    scene: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE",
            autocompletion=completing.scenes,
            help="Hidden scene of the simulated rig, or a mesh file. [dim]\\[default: letters][/dim]",
        ),
    ] = None,
    place: Place = None,
    rotate: Rotate = None,
    scale: Scale = None,
    preset: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            autocompletion=completing.presets,
            help="A dataset of the paper, e.g. office-10ms; 'list' names all.",
        ),
    ] = None,
    seed: Seed = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            rich_help_panel=RESULTS,
            metavar="SCAN.h5",
            help="The scan file. [dim]\\[default: scan-DATE-TIME.h5][/dim]",
        ),
    ] = None,
    operator: Operator = None,
    sample: Sample = None,
    purpose: Purpose = None,
    note: Note = None,
    ptu: Ptu = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show positions, time, bytes and limits; use no device.")
    ] = False,
    live: Live = False,
    web: Web = None,
    fresh_to: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=MEANWHILE,
            metavar="DEPTH",
            help="With --live and --frames: average frames: one frame more for each time that a voxel is "
            "this deep. "
            "[dim]\\[default: never][/dim]",
        ),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(
            rich_help_panel=MEANWHILE,
            metavar="FILE.gif",
            help="With --live and --frames: a video of them; .mp4 needs ffmpeg.",
        ),
    ] = None,
    yes: Yes = False,
    as_json: AsJson = False,
) -> None:
    """Scan the relay wall and store the photons of each position.

    [bold]Examples[/bold]

      # simulated rig, the whole wall
      rig scan --exposure 10ms
      # a coarse one, quickly
      rig scan --grid 60x44 --spacing 3cm
      # the whole wall in 24 s, once the mirror is loaded
      rig scan --exposure 1ms --mode continuous
      # a dataset of the paper
      rig scan --preset office-10ms
      # a mesh in millimetres
      rig scan --scene model.obj --scale 0.001 --place 0cm,0cm,1.2m
      # what would be done
      rig scan --config lab.toml --dry-run
      # a moving hidden object, frame by frame
      rig scan --config configs/video.toml --frames 10
      # and seen meanwhile
      rig scan --config configs/video.toml --mode continuous --frames 10 --live

    Ctrl-C stops within half a second: the laser goes dark, the file is closed, rig resume goes on.
    """
    if preset == "list":
        _show_presets(as_json)
        return
    from rig.acquire.acquisition import acquire
    from rig.acquire.preflight import check
    from rig.bench.simulated import hidden_scene
    from rig.commands import console
    from rig.commands.consent import require_consent
    from rig.commands.operator import ConsoleOperator
    from rig.commands.running import Onlookers, ending, page_at, run
    from rig.files.records import beside
    from rig.model import asked
    from rig.model.quantities import parse
    from rig.model.state import RigState

    notes = {"operator": operator, "sample": sample, "purpose": purpose, "note": note}
    simulation = {"scene": scene, "seed": seed, **asked.placement(place, rotate, scale)}
    state = RigState.resolve(asked.configuration(config, preset, simulation, notes))
    plan = asked.plan(
        state.config,
        exposure=exposure,
        grid=grid,
        spacing=spacing,
        mode=mode.value,
        frames=frames,
        order=order.value,
    )
    _check_film(plan, live or web is not None, fresh_to, video)
    end = ending(until, plan) if until else None
    target = out or Path(_default_name())
    require_free([target, *([video] if video else [])])
    if ptu:
        _check_ptu(plan)
    if state.config.simulation:
        hidden_scene(state.config)  # a dry run refuses a wrong name, too
    found = check(plan, state, target.parent)
    if found.hidden:
        console.say(found.hidden.words)
        for sentence in found.hidden.warnings:
            console.warn(sentence)
    if config is None:
        console.say("No configuration given: using the built-in simulated rig.")
    if dry_run:
        _show_plan(plan, state, found, as_json)
        return
    if state.calibrations.records:
        console.say(f"Calibrations: {state.calibrations.in_words()}")
    page = page_at(web)
    require_consent(state.config, yes=yes)
    needed = None if state.config.simulated else config
    fresh_to_m = parse(fresh_to, "length") if fresh_to else None
    others = Onlookers(end, live, fresh_to_m, video, page, state.config.notify)
    records = beside(target) if ptu else None
    run(
        lambda watch: acquire(
            plan,
            state,
            target,
            replace(watch, records=records),
            ConsoleOperator(watch.should_stop, yes=yes),
        ),
        plan,
        target,
        as_json,
        needed,
        others,
    )


def _check_film(plan: "ScanPlan", live: bool, fresh_to: str | None, video: Path | None) -> None:
    """Refuse what is asked of live images of frames, where there are none."""
    from rig.errors import UsageError
    from rig.model.quantities import parse

    asked = {"--fresh-to": fresh_to, "--video": video}
    names = [name for name, value in asked.items() if value is not None]
    if names and not (live and plan.frames > 1):
        raise UsageError(
            f"{' and '.join(names)} would have no effect without --live and --frames; add them, or make the "
            "video afterwards: rig recon --each-frame"
        )
    if fresh_to and not parse(fresh_to, "length") > 0:
        raise UsageError(f"--fresh-to {fresh_to}: the depth must be above 0; use e.g. 1m")
    if video is not None:
        from rig.show.endings import check_video

        check_video(video)


def _check_ptu(plan: "ScanPlan") -> None:
    """Refuse to keep records that are not made, or have no end."""
    from rig.errors import UsageError

    if not plan.continuous:
        raise UsageError("--ptu keeps records, which only --mode continuous has; add it, or leave --ptu out")
    if plan.endless:
        raise UsageError(
            "--ptu is not possible for a scan without a last frame; give --frames a number, "
            "or leave --ptu out"
        )


def _show_presets(as_json: bool) -> None:
    from rig.commands import console
    from rig.model.presets import about

    if as_json:
        console.print_json({"presets": about()})
    else:
        console.print_facts("presets: the datasets of Liu et al. 2019", about())


def _default_name() -> str:
    from datetime import datetime

    return datetime.now().strftime("scan-%Y%m%d-%H%M%S.h5")


def _show_plan(plan: "ScanPlan", state: "RigState", found: "Estimate", as_json: bool) -> None:
    from math import degrees

    from rig.commands import console
    from rig.model.plan import Grid
    from rig.model.quantities import show, show_bytes, show_duration, show_length

    config, (one,) = state.config, plan.passes
    grid = one.positions
    assert isinstance(grid, Grid)
    angles = [round(degrees(angle), 9) for angle in found.mirror_rad]
    most_rad = (config.galvo.max_angle_x_rad, config.galvo.max_angle_y_rad)
    limits = [round(degrees(angle), 9) for angle in most_rad]  # 24, not 23.999999999999996
    if as_json:
        console.print_json(
            {
                "rig": config.name,
                "simulated": config.simulated,
                "plan": plan.model_dump(mode="json"),
                "positions": len(plan),
                "frames": one.frames,
                "skipped": grid.skipped,
                "rounds": grid.rounds,
                "exposure_total_s": plan.exposure_total_s,
                "duration_s": found.duration_s,
                "sweeps": found.sweeps,
                "loading_s": found.loading_s,
                "bytes_in_memory": found.bytes_in_memory,
                "bytes_on_disk": found.bytes_on_disk,
                "mirror_angle_deg": angles,
                "mirror_limit_deg": limits,
                "calibrations": sorted(state.calibrations.records),
                "unverified": list(config.unverified),
            }
        )
        return
    width_m, height_m = grid.area_m
    frame_s = found.duration_s / one.frames
    each = f"of {len(grid.spots_m):,} positions, ~{show_duration(frame_s)} each"
    frames = {"frames": f"until stopped, {each}" if plan.endless else f"{one.frames} {each}"}
    lines_apart = f", lines {show_length(grid.row_spacing_m)}" if grid.row_spacing_m else ""
    channels = len(state.channels)
    console.print_facts(
        f"{config.name}: plan, nothing was moved",
        {
            "positions": f"{len(grid.spots_m):,} of {grid.columns} x {grid.rows}, "
            f"{show_length(grid.spacing_m)} apart{lines_apart}; {grid.skipped} skipped around the detector's "
            "spot",
            **(frames if one.frames > 1 else {}),
            "order": _order_in_words(grid),
            "area": f"{show_length(width_m)} x {show_length(height_m)}",
            "exposure": f"{show(one.exposure_s, 's')} each, {show_duration(plan.exposure_total_s)} of light",
            "time": f"~{show_duration(found.duration_s)} on hardware, with " + _beside_exposure(plan, found),
            **({"loading": _loading_in_words(found)} if found.loading_s else {}),
            "photons"
            if plan.continuous
            else "histogram": f"{found.bins:,} bins of {show(found.bin_width_s, 's')}"
            + (f", {channels} channels" if channels > 1 else ""),
            "file": f"~{show_bytes(found.bytes_on_disk)} compressed, "
            f"{show_bytes(found.bytes_in_memory)} of counts",
            "mirror": f"{angles[0]:.1f} x {angles[1]:.1f} deg, limits {limits[0]:.1f} x {limits[1]:.1f} deg",
            "calibrations": state.calibrations.in_words() or "none: as configured",
            **({"not verified": "\n".join(config.unverified)} if config.unverified else {}),
        },
    )


def _loading_in_words(found: "Estimate") -> str:
    from rig.model.sweep import loading_in_words

    sweeps = f"{found.sweeps} sweeps" if found.sweeps > 1 else "one sweep"
    return f"{sweeps}: {loading_in_words(found.loaded, found.loading_s)}"


def _beside_exposure(plan: "ScanPlan", found: "Estimate") -> str:
    """Say what takes time beside exposures."""
    if not plan.continuous:
        return "settling and readout"
    return "turns between lines" + (" and loading" if found.loading_s else "")


def _order_in_words(grid: "GridPositions") -> str:
    if grid.order != "progressive":
        return {
            "snake": "raster, lines alternate in direction",
            "unidirectional": "raster, all lines run to the right",
            "random": "random",
        }[grid.order]
    return "progressive, the whole wall seen after " + ", ".join(f"{count:,}" for count in grid.rounds)
