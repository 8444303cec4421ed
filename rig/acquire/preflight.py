"""What is known of a scan before anything moves: how much it is, and whether the rig can do it."""

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rig.acquire.abilities import require_point_clock, tagging_of
from rig.acquire.times import check_times
from rig.bench.placed import Hidden, looked_at
from rig.devices.kinds import check_settings, loading, time_axis, timing_limits
from rig.errors import RefusedError, UsageError
from rig.files.writer import RESERVE_BYTES
from rig.model.config import HarpConfig
from rig.model.plan import Grid, ScanPlan
from rig.model.quantities import show_bytes, show_length
from rig.model.state import RigState
from rig.model.sweep import Trajectories

#: Bytes that one photon takes in a compressed scan file, measured on simulated scans (gzip level 1).
BYTES_PER_PHOTON = 0.85
#: Detections a second that the size estimate assumes (the paper's Table 1: 205 to 265 thousand).
ASSUMED_RATE_HZ = 265e3


@dataclass(frozen=True)
class Estimate:
    """How much a scan is.

    Attributes
    ----------
    bins, bin_width_s
        Of each histogram.
    bytes_in_memory
        Size of all histograms, uncompressed.
    bytes_on_disk
        Of the compressed scan file, at the paper's count rate.
    mirror_rad
        Largest optical angles that it needs, right and up.
    duration_s
        How long it takes on hardware, with settling and readout, or with turns and the loading of the mirror.
    sweeps, loaded, loading_s
        Of a mirror that never stops: number of sweeps, positions that are loaded into it for all of them, and
        how long that takes; 0 of one that stops.
    hidden
        What is known of a mesh that is the hidden scene of a simulated rig, once it was looked at.
    """

    bins: int
    bin_width_s: float
    bytes_in_memory: int
    bytes_on_disk: int
    mirror_rad: tuple[float, float]
    duration_s: float
    sweeps: int = 0
    loaded: int = 0
    loading_s: float = 0.0
    hidden: Hidden | None = None


def estimate(plan: ScanPlan, state: RigState) -> Estimate:
    """Say how much a scan is.

    Raises
    ------
    RefusedError
        If the plan goes beyond what was calibrated, or its order is none for a mirror that never stops.
    """
    bins, bin_width_s = time_axis(state.config)
    in_memory = len(plan) * len(state.channels) * bins * 4
    photons = plan.exposure_total_s * ASSUMED_RATE_HZ * len(state.channels)
    on_disk = int(min(in_memory, photons * BYTES_PER_PHOTON + len(plan) * 500))
    angles_rad = state.pointing.angles_rad(plan.spots_m)
    if not plan.continuous:
        x_rad, y_rad = np.abs(angles_rad).max(axis=0).tolist()
        return Estimate(bins, bin_width_s, in_memory, on_disk, (x_rad, y_rad), plan.duration_s(state.config))
    told = loading(state.config.galvo)
    way = Trajectories(plan, angles_rad, state.config.galvo.turn_time_s).way(told.longest)
    loading_s = sum(map(told.duration_s, way.positions))
    return Estimate(
        bins,
        bin_width_s,
        in_memory,
        on_disk,
        way.farthest_rad,
        way.duration_s + loading_s,
        sweeps=len(way.positions),
        loaded=sum(way.positions),
        loading_s=loading_s,
    )


def check(plan: ScanPlan, state: RigState, folder: Path) -> Estimate:
    """Refuse what the rig or the disk cannot do, before anything moves, and say how much the scan is.

    Parameters
    ----------
    plan, state
        What is to be measured, and on what rig.
    folder
        Where the scan file shall be.

    Raises
    ------
    UsageError
        If there is no such folder.
    RefusedError
        As `check_rig`; or if the disk would overflow.
    drivers.errors.LimitError
        As `check_rig`.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder} is not a folder; create it first, or choose another place with --out")
    found = check_rig(plan, state)
    free = shutil.disk_usage(folder).free
    needed = (found.bytes_on_disk + RESERVE_BYTES) / 0.95
    if needed > free:
        raise RefusedError(
            f"the scan needs {show_bytes(needed)} free, about {show_bytes(found.bytes_on_disk)} of them for "
            f"photons and the rest so that its end can be written; {folder} has {show_bytes(free)} free. "
            "Free some space, or choose another place with --out"
        )
    return found


def check_rig(plan: ScanPlan, state: RigState) -> Estimate:
    """Refuse what the rig cannot do, before anything moves; the disk is not looked at.

    Raises
    ------
    RefusedError
        If a spot is outside the mirror's limits, times do not fit each other, or the rig has not what a
        mirror that never stops needs.
    drivers.errors.LimitError
        If laser or timing instrument cannot be set so.
    """
    plan.require_positions()
    found = estimate(plan, state)
    _check_angles(plan, state, found)
    if plan.continuous:
        tagging, _ = tagging_of(state.config), require_point_clock(state.config.point_clock)
        tagging.check(state.config)
    check_settings(state.config)
    limits = timing_limits(state.config)
    limits.check_histogram(found.bins, found.bin_width_s)
    for one in plan.passes:
        if one.motion == "step":  # otherwise the point clock ticks, of which the instrument knows nothing
            limits.check_exposure(one.exposure_s)
    check_times(plan, state)
    return replace(found, hidden=_look_at_mesh(plan, state))


def _look_at_mesh(plan: ScanPlan, state: RigState) -> Hidden | None:
    """Refuse a mesh that the record of a simulated scan does not hold."""
    config, gate = state.config, state.gate
    if config.simulation is None or config.simulation.mesh is None:
        return None
    bins, bin_width_s = time_axis(config)
    begin_s = config.tcspc.offset_s if isinstance(config.tcspc, HarpConfig) else 0.0
    end_s = begin_s + bins * bin_width_s
    if gate:
        begin_s, end_s = max(begin_s, gate.delay_s), min(end_s, gate.delay_s + gate.width_s)
    detector_m = np.array([channel.spot_m for channel in state.channels])
    delay_s = state.delays.delay_s(plan.spots_m[:, None], detector_m)
    record_s = begin_s - float(delay_s.max()), end_s - float(delay_s.min())
    return looked_at(config, plan.spots_m, detector_m, record_s)


def _check_angles(plan: ScanPlan, state: RigState, found: Estimate) -> None:
    galvo = state.config.galvo
    limits = (galvo.max_angle_x_rad, galvo.max_angle_y_rad)
    is_grid = isinstance(plan.passes[0].positions, Grid)
    nearer = (
        "Use a smaller grid or spacing" if is_grid else "Choose a position nearer to the middle of the wall"
    )
    for axis, angle, limit in zip("xy", found.mirror_rad, limits, strict=True):
        if angle > limit:
            raise RefusedError(
                f"{_in_words(plan)} needs {np.degrees(angle):.1f} deg of mirror angle in {axis}, "
                f"but the limit is {np.degrees(limit):.1f} deg. {nearer}, "
                f"or raise galvo.max_angle_{axis} if the mirror can do it"
            )


def _in_words(plan: ScanPlan) -> str:
    grid = plan.passes[0].positions
    if not isinstance(grid, Grid):
        return f"the list of {len(plan)} positions" if len(plan) > 1 else "this position"
    lines = f" x {show_length(grid.row_spacing_m)}" if grid.row_spacing_m else ""
    return f"the grid of {grid.columns} x {grid.rows} at {show_length(grid.spacing_m)}{lines}"
