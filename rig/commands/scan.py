"""``rig scan``: measure the relay wall."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.consent import Yes
from rig.commands.options import (
    BUILT_IN,
    UNTIL_STOPPED,
    AsJson,
    Config,
    Frames,
    Grid,
    Live,
    Mode,
    Note,
    Operator,
    Order,
    Ptu,
    Purpose,
    Sample,
    Seed,
    Spacing,
    Until,
)
from rig.commands.results import require_free

if TYPE_CHECKING:
    from rig.acquire.preflight import Estimate
    from rig.model.config import RigConfig
    from rig.model.plan import Grid as GridPositions
    from rig.model.plan import ScanPlan
    from rig.model.state import RigState


def scan(
    config: Config = None,
    exposure: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="Measurement time at each position. [dim]\\[10ms][/dim]"),
    ] = None,
    grid: Grid = None,
    spacing: Spacing = None,
    mode: Annotated[
        Mode,
        typer.Option(
            help="step: the mirror rests at each position. continuous: it never stops along a line, and each "
            "photon is recorded with its time; much faster at short exposures."
        ),
    ] = Mode.STEP,
    frames: Frames = None,
    order: Annotated[
        Order,
        typer.Option(
            help="raster: line by line, there and back. unidirectional: all lines the same way. progressive: "
            "coarse to fine, the whole wall again and again. random: anywhere."
        ),
    ] = Order.RASTER,
    until: Until = None,
    scene: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE",
            help="Hidden scene of the simulated rig, or a mesh file. [dim]\\[letters][/dim]",
        ),
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="A dataset of the paper, e.g. office-10ms; 'list' names all."),
    ] = None,
    seed: Seed = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="SCAN.h5", help="The scan file. [dim]\\[scan-DATE-TIME.h5][/dim]"
        ),
    ] = None,
    operator: Operator = None,
    sample: Sample = None,
    purpose: Purpose = None,
    note: Note = None,
    ptu: Ptu = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show positions, time, bytes and limits; touch no device.")
    ] = False,
    live: Live = False,
    fresh_to: Annotated[
        str | None,
        typer.Option(
            metavar="DEPTH",
            help="With --live and --frames: average frames, one for each time that a voxel is so deep. "
            "[dim]\\[never][/dim]",
        ),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.gif", help="With --live and --frames: a video of them; .mp4 needs ffmpeg."
        ),
    ] = None,
    yes: Yes = False,
    as_json: AsJson = False,
) -> None:
    """Scan the relay wall and store the photons of each position.

    [bold]Examples[/bold]

      rig scan --exposure 10ms               simulated rig, the whole wall

      rig scan --grid 60x44 --spacing 3cm    a coarse one, quickly

      rig scan --exposure 1ms --mode continuous    the whole wall in 24 s, once the mirror is loaded

      rig scan --preset office-10ms          a dataset of the paper

      rig scan --config lab.toml --dry-run   what would be done

      rig scan --config configs/video.toml --frames 10    a moving hidden object, frame by frame

      rig scan --config configs/video.toml --mode continuous --frames 10 --live    and seen meanwhile

    Ctrl-C stops within half a second: the laser goes dark, the file is closed, rig resume goes on.
    """
    from rig.acquire.acquisition import acquire
    from rig.acquire.preflight import check
    from rig.commands import console
    from rig.commands.consent import require_consent
    from rig.commands.operator import ConsoleOperator
    from rig.commands.running import Onlookers, ending, run
    from rig.errors import UsageError
    from rig.files.records import beside
    from rig.model.plan import ScanPlan
    from rig.model.quantities import parse
    from rig.model.state import RigState

    if preset == "list":
        _show_presets(as_json)
        return
    notes = {"operator": operator, "sample": sample, "purpose": purpose, "note": note}
    state = RigState.resolve(configured(config, preset, {"scene": scene, "seed": seed}, notes))
    columns, rows = columns_and_rows(grid) if grid else (None, None)
    plan = ScanPlan.grid(
        state.config,
        columns=columns,
        rows=rows,
        spacing_m=parse(spacing, "length") if spacing else None,
        exposure_s=parse(exposure, "time") if exposure else None,
        order=order.in_plan,
        motion=mode.value,
        **_frames(frames, mode),
    )
    _check_film(plan, live, fresh_to, video)
    end = ending(until, plan) if until else None
    target = out or Path(_default_name())
    require_free([target, *([video] if video else [])])
    if ptu and not plan.continuous:
        raise UsageError(
            "--ptu keeps records, which --mode continuous alone makes; add it, or leave --ptu out"
        )
    if ptu and plan.endless:
        raise UsageError(
            "--ptu cannot be kept of a scan without a last frame; give --frames a number, or leave --ptu out"
        )
    found = check(plan, state, target.parent)
    if config is None:
        console.say("No configuration given: using the built-in simulated rig.")
    if dry_run:
        _show_plan(plan, state, found, as_json)
        return
    if state.calibrations.records:
        console.say(f"Calibrations: {state.calibrations.in_words()}")
    require_consent(state.config, yes=yes)
    needed = None if state.config.simulated else config
    fresh_to_m = parse(fresh_to, "length") if fresh_to else None
    others = Onlookers(end, live, fresh_to_m, video, state.config.notify)
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


def _frames(text: str | None, mode: Mode) -> dict[str, object]:
    """Read the option --frames, as the plan has it."""
    from rig.errors import UsageError
    from rig.model.plan import FIRST_FRAMES

    if text is None:
        return {}
    if text.strip() != UNTIL_STOPPED:
        if not (text.isascii() and text.isdecimal() and len(text) < 10 and int(text) > 0):
            raise UsageError(
                f"'{text}' is no number of frames; write one from 1 on, e.g. --frames 10, or "
                f"--frames {UNTIL_STOPPED}"
            )
        return {"frames": int(text)}
    if mode is not Mode.CONTINUOUS:
        raise UsageError(
            f"--frames {UNTIL_STOPPED} needs --mode continuous; add it, or give a number of frames"
        )
    return {"frames": FIRST_FRAMES, "until_stopped": True}


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
        raise UsageError(f"--fresh-to {fresh_to}: frames are averaged from a depth above 0 on; use 1m")
    if video is not None:
        from rig.show.video import check_video

        check_video(video)


def _show_presets(as_json: bool) -> None:
    from rig.commands import console
    from rig.model.presets import about

    if as_json:
        console.print_json({"presets": about()})
    else:
        console.print_facts("presets: the datasets of Liu et al. 2019", about())


def configured(
    path: Path | None, preset: str | None, simulation: dict[str, object], notes: dict[str, str | None]
) -> "RigConfig":
    """Return the configuration of a file, or of the built-in rig, with what options say (None: nothing)."""
    from rig.errors import UsageError
    from rig.model.config import built_in_with, load
    from rig.model.presets import merged
    from rig.model.presets import preset as changes_of

    overlay = changes_of(preset) if preset else {}
    given = {name: value for name, value in simulation.items() if value is not None}
    said = {name: text for name, text in notes.items() if text is not None}
    if path and (preset or given) and not load(path).simulated:
        option = "preset" if preset else next(iter(given))
        raise UsageError(
            f"--{option} is for the simulated rig, and {path} names real devices; leave it out, or use "
            f"--config {BUILT_IN}"
        )
    changes = merged(overlay, {"simulation": given} if given else {})
    changes = merged(changes, {"notes": said} if said else {})
    return load(path, changes) if path else built_in_with(changes)


def columns_and_rows(text: str) -> tuple[int, int]:
    """Read a grid like 180x130.

    Raises
    ------
    rig.errors.UsageError
        If it is none.
    """
    from rig.errors import UsageError

    columns, separator, rows = text.lower().partition("x")
    numbers = [text.strip() for text in (columns, rows)]
    plain = all(number.isascii() and number.isdecimal() and len(number) < 10 for number in numbers)
    if not (separator and plain and min(map(int, numbers)) > 1):
        raise UsageError(
            f"'{text}' is not a grid; write columns and rows, each at least 2, e.g. --grid 180x130"
        )
    return int(numbers[0]), int(numbers[1])


def _default_name() -> str:
    from datetime import datetime

    return datetime.now().strftime("scan-%Y%m%d-%H%M%S.h5")


def _show_plan(plan: "ScanPlan", state: "RigState", found: "Estimate", as_json: bool) -> None:
    from math import degrees

    from rig.commands import console
    from rig.model.plan import Grid
    from rig.model.quantities import show, show_duration, show_length

    config, (one,) = state.config, plan.passes
    grid = one.positions
    assert isinstance(grid, Grid)
    angles = [degrees(angle) for angle in found.mirror_rad]
    limits = [degrees(config.galvo.max_angle_x_rad), degrees(config.galvo.max_angle_y_rad)]
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
            "file": f"~{found.bytes_on_disk / 1e6:.0f} MB compressed, "
            f"{found.bytes_in_memory / 1e6:.0f} MB of counts",
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
