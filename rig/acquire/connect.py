"""The composition root: opens the devices that a configuration names, real or simulated at their wires."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from drivers.daq.board import SharedBoard
from drivers.harp.library import HarpLibrary
from drivers.video_camera import VideoCamera
from rig.acquire.abilities import tagging_of
from rig.acquire.engine import Devices
from rig.devices.kinds import DETECTORS, GALVOS, LASERS, POINT_CLOCKS, TIMING, Wires
from rig.devices.wires import wires_by_address
from rig.light.guarded import GuardedHere
from rig.light.lock import locked
from rig.light.remote import GuardedElsewhere
from rig.model.config import RigConfig
from rig.model.devices import GatedSpad, GuardedLaser, Operator, PointClock, Tcspc, TimeTagger, WallCamera

if TYPE_CHECKING:
    from simulators.bench import Bench


@dataclass(frozen=True)
class Station:
    """A whole rig for calibration: devices, the person at it, and the cameras that see the wall."""

    devices: Devices
    operator: Operator
    cameras: tuple[WallCamera, ...]


@contextmanager
def open_devices(
    config: RigConfig, first: int = 0, *, tagged: bool = False, begin_s: float = 0.0
) -> Iterator[Devices]:
    """Open and identify all devices; leave all of them safe at the end, the laser first.

    Parameters
    ----------
    config
        Names them.
    first
        Step of the plan with which the scan begins.
    tagged
        Whether the timing instrument is to record each photon, and the point clock to mark positions among
        them, instead of histograms that the instrument makes.
    begin_s
        Time at which the clock of a simulated bench begins.

    Raises
    ------
    drivers.errors.DeviceError
        If a device is missing, is another one, or fails.
    RefusedError
        If the timing instrument cannot record so.
    """
    with ExitStack() as stack:
        if config.simulated:
            wires, _ = stack.enter_context(_simulated(config, begin_s))
        else:
            stack.enter_context(locked(config))
            wires = stack.enter_context(wires_by_address(config))
        yield stack.enter_context(devices_on(config, wires, first, tagged=tagged))


@contextmanager
def devices_on(config: RigConfig, wires: Wires, first: int = 0, *, tagged: bool = False) -> Iterator[Devices]:
    """Open and identify the devices at the ends of these wires; leave them safe at the end, the laser first.

    Parameters and errors are those of `open_devices`.
    """
    with ExitStack() as stack:
        galvo = stack.enter_context(GALVOS.of(config.galvo).open(config.galvo, wires))
        clock = stack.enter_context(_point_clock(config, wires, tagged))
        spad = stack.enter_context(DETECTORS.of(config.detector).open(config.detector, wires))
        yield Devices(
            galvo=galvo,
            point_clock=clock,
            spad=spad,
            tcspc=stack.enter_context(_timing(config, wires, first, tagged)),
            laser=_guarded(config, wires, stack, spad),  # the last, so that it is the first to be made safe
            clock=wires.clock,
        )


def _point_clock(config: RigConfig, wires: Wires, tagged: bool) -> AbstractContextManager[PointClock | None]:
    if config.point_clock is None or not tagged:
        return nullcontext()
    return POINT_CLOCKS.of(config.point_clock).open(config.point_clock, wires)


def _timing(
    config: RigConfig, wires: Wires, first: int, tagged: bool
) -> AbstractContextManager[Tcspc | TimeTagger]:
    if tagged:
        return tagging_of(config).open(config, wires)
    return TIMING.of(config.tcspc).open(config, wires, first)


@contextmanager
def open_station(config: RigConfig, operator: Operator, *, tagged: bool = False) -> Iterator[Station]:
    """Open devices and cameras. On the simulated rig the bench takes the place of ``operator``.

    ``tagged`` as of `open_devices`.

    Raises
    ------
    drivers.errors.DeviceError
        If a device is missing, is another one, or fails.
    """
    cameras: tuple[WallCamera, ...] = ()
    with ExitStack() as stack:
        if config.simulated:
            wires, bench = stack.enter_context(_simulated(config))
            from rig.bench.operator import simulated_operator

            operator, cameras = simulated_operator(bench)
        else:
            stack.enter_context(locked(config))
            wires = stack.enter_context(wires_by_address(config))
            cameras = tuple(stack.enter_context(VideoCamera(one)) for one in config.cameras.addresses)
        yield Station(stack.enter_context(devices_on(config, wires, tagged=tagged)), operator, cameras)


@contextmanager
def _simulated(config: RigConfig, begin_s: float = 0.0) -> "Iterator[tuple[Wires, Bench]]":
    """Build the simulated bench and put its devices at the ends of the wires."""
    from rig.bench.simulated import simulated_instruments

    bench, instruments = simulated_instruments(config, begin_s)
    bench.warm_up()
    board = SharedBoard(instruments.daq)
    with instruments:
        yield (
            Wires(
                galvo=instruments.galvo_url,
                laser=instruments.laser_url,
                usb_backend=instruments.usb_backend,
                harp=partial(HarpLibrary, instruments.harp),
                daq=lambda device: board,
                clock=bench.clock,
            ),
            bench,
        )


def _guarded(config: RigConfig, wires: Wires, stack: ExitStack, spad: GatedSpad) -> GuardedLaser:
    """Open the laser behind its guard: a process of its own, unless laser and program end together anyway."""
    if config.simulated:
        laser = stack.enter_context(LASERS.of(config.laser).open(config.laser, wires))
        return GuardedHere(laser, wires.clock)
    guarded = GuardedElsewhere(config)
    guarded.when_hanging.append(spad.disable)
    return stack.enter_context(guarded)
