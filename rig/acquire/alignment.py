"""One spot, or a circle of spots, lit again and again while a person aligns the optics; nothing is recorded.

It is a scan by all its rules: engine, checks, guard and watch are the same; its plan goes lap by lap.
"""

from math import ceil, inf

import numpy as np
from numpy.typing import NDArray

from rig.acquire.acquisition import Watch, describe
from rig.acquire.connect import open_devices
from rig.acquire.engine import Devices, ScanEngine
from rig.acquire.events import Ended, Event, Ready
from rig.acquire.preflight import check_rig
from rig.acquire.vigil import READ_BACK_S
from rig.errors import RefusedError, UsageError
from rig.model.devices import Operator
from rig.model.plan import MAX_STEPS, Pass, Point, ScanPlan, Spots
from rig.model.quantities import show_duration
from rig.model.state import RigState

#: Spots of a circle: 30 degrees apart.
OF_A_CIRCLE = 12


def circle(x_m: float, y_m: float, radius_m: float) -> tuple[Point, ...]:
    """Return the spots of a circle on the wall, from the right, counter-clockwise.

    Raises
    ------
    UsageError
        If it has no radius.
    """
    if not radius_m > 0:
        raise UsageError(
            f"a circle's radius must be above 0, but {radius_m:g} m was asked for; use --at for a spot"
        )
    angles = 2 * np.pi * np.arange(OF_A_CIRCLE) / OF_A_CIRCLE
    return tuple(
        (float(x_m + radius_m * np.cos(angle)), float(y_m + radius_m * np.sin(angle)), 0.0)
        for angle in angles
    )


def usual_spot(state: RigState) -> Point:
    """Return the position of the configured scan that is nearest to the wall's middle."""
    spots_m: NDArray[np.float64] = ScanPlan.grid(state.config).spots_m
    x_m, y_m, z_m = spots_m[np.linalg.norm(spots_m, axis=1).argmin()].tolist()
    return x_m, y_m, z_m


def lap(spots: tuple[Point, ...], exposure_s: float) -> ScanPlan:
    """Return the plan of one lap, for `check_alignment`.

    Raises
    ------
    UsageError
        If there is no exposure.
    """
    if not exposure_s > 0:
        raise UsageError(f"an exposure must be above 0, but {exposure_s:g} s was asked for; use e.g. 100ms")
    return ScanPlan(passes=(Pass(positions=Spots(spots=spots), exposure_s=exposure_s),))


def laps(once: ScanPlan, longest_s: float) -> ScanPlan:
    """Return the plan of more laps than go into a time.

    Its lines, after each of which the whole rig is read back, have as many laps as last until that is due.

    Raises
    ------
    UsageError
        If these are more steps than a plan can have.
    """
    (one,) = once.passes
    assert isinstance(one.positions, Spots)
    if not longest_s > 0:
        raise UsageError(
            f"light for {longest_s:g} s was asked for; use a time above 0 with --for, e.g. 20min"
        )
    steps = longest_s / one.exposure_s
    if steps > MAX_STEPS / 2:
        most_s = MAX_STEPS / 2 * one.exposure_s
        raise UsageError(
            f"the light can be on for {show_duration(most_s)} at most at this exposure; change --for, "
            "or use a longer exposure"
        )
    of_a_line = ceil(READ_BACK_S / one.exposure_s / len(once))
    spots = Spots(spots=one.positions.spots * of_a_line)
    frames = ceil(steps / len(spots.spots)) + 1  # so that it is the time that ends them
    return ScanPlan(passes=(one.model_copy(update={"positions": spots, "frames": frames}),))


def check_alignment(once: ScanPlan, state: RigState) -> None:
    """Refuse what the rig cannot do, before anything moves, as `rig.acquire.preflight.check_rig` does.

    Raises
    ------
    RefusedError
        Also where the photons are those of a file, to which no screw matters.
    """
    if state.config.tcspc.kind == "playback":
        raise RefusedError(
            "tcspc.kind = 'playback' plays the photons of a file, which cannot be used to align optics: "
            "configure the rig's timing instrument"
        )
    check_rig(once, state)


def align(
    plan: ScanPlan, state: RigState, longest_s: float, watch: Watch, operator: Operator | None = None
) -> Ended:
    """Light the spots of a plan, one after the other, until a stop is asked for or the time is over.

    The laser is dark and the detector unbiased when this returns or raises.

    Parameters
    ----------
    plan, state
        The laps, whose spots were checked, and the rig.
    longest_s
        For how long there is light at most.
    watch
        Who looks on.
    operator
        Who sets by hand what has no data interface.

    Raises
    ------
    drivers.errors.DeviceError
        If a device fails.
    rig.errors.RefusedError
        If the light is lost, the detector gets too much of it, or the rig is no longer as it was.
    """
    with open_devices(state.config, operator=operator) as devices:
        return align_on(devices, plan, state.of_devices(devices.identities()), longest_s, watch)


def align_on(devices: Devices, plan: ScanPlan, state: RigState, longest_s: float, watch: Watch) -> Ended:
    """Do the same on open devices."""
    over, ends_s = f"the requested time is over ({show_duration(longest_s)})", inf

    def heard(event: Event) -> None:
        nonlocal ends_s
        if isinstance(event, Ready):
            ends_s = devices.clock.now_s() + longest_s
        for consumer in watch.consumers:
            consumer(event)

    def asked() -> bool | str:
        return watch.should_stop() or (over if devices.clock.now_s() >= ends_s else False)

    watch.begun(describe(plan, state, devices))
    return ScanEngine(devices, plan, state, adjusted=True).run(heard, asked)
