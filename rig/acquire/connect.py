"""The composition root: opens the devices that a configuration names, real or simulated at their wires."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from drivers.clock import SystemClock
from drivers.hydraharp.library import HHLib
from drivers.hydraharp.loading import load_library
from drivers.video_camera import VideoCamera
from rig.acquire.engine import Devices
from rig.acquire.kinds import DETECTORS, GALVOS, LASERS, TIMING, Wires
from rig.model.config import HydraHarpConfig, RigConfig
from rig.model.devices import Operator, WallCamera

if TYPE_CHECKING:
    from simulators.bench import Bench


@dataclass(frozen=True)
class Station:
    """A whole rig for calibration: devices, the person at it, and the cameras that see the wall."""

    devices: Devices
    operator: Operator
    cameras: tuple[WallCamera, ...]


@contextmanager
def open_devices(config: RigConfig, first: int = 0) -> Iterator[Devices]:
    """Open and identify all devices; leave all of them safe at the end, the laser first.

    Parameters
    ----------
    config
        Names them.
    first
        Step of the plan with which the scan begins.

    Raises
    ------
    drivers.errors.DeviceError
        If a device is missing, is another one, or fails.
    """
    with ExitStack() as stack:
        if config.simulated:
            wires, _ = stack.enter_context(_simulated(config))
        else:
            wires = stack.enter_context(_by_address(config))
        yield _open(config, wires, stack, first)


@contextmanager
def open_station(config: RigConfig, operator: Operator) -> Iterator[Station]:
    """Open devices and cameras. On the simulated rig the bench takes the place of ``operator``.

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
            wires = stack.enter_context(_by_address(config))
            cameras = tuple(stack.enter_context(VideoCamera(one)) for one in config.cameras.addresses)
        yield Station(_open(config, wires, stack, 0), operator, cameras)


@contextmanager
def _by_address(config: RigConfig) -> Iterator[Wires]:
    """Reach each device where the configuration says that it is: real, or served by another process."""
    from rig.bench.reached import detector_at, timing_at

    detector = config.detector
    harp = config.tcspc if isinstance(config.tcspc, HydraHarpConfig) else HydraHarpConfig()
    hhlib: Callable[[], HHLib] = partial(load_library, harp.library)
    with ExitStack() as stack:
        usb_backend = stack.enter_context(detector_at(detector.address)) if detector.address else None
        if harp.address:
            hhlib = partial(HHLib, stack.enter_context(timing_at(harp.address)))
        yield Wires(
            galvo=config.galvo.address or "",
            laser=config.laser.address or "",
            usb_backend=usb_backend,
            hhlib=hhlib,
            clock=SystemClock(),
        )


@contextmanager
def _simulated(config: RigConfig) -> "Iterator[tuple[Wires, Bench]]":
    """Build the simulated bench and put its devices at the ends of the wires."""
    from rig.bench.simulated import simulated_instruments

    bench, instruments = simulated_instruments(config)
    with instruments:
        yield (
            Wires(
                galvo=instruments.galvo_url,
                laser=instruments.laser_url,
                usb_backend=instruments.usb_backend,
                hhlib=lambda: HHLib(instruments.hhlib),
                clock=bench.clock,
            ),
            bench,
        )


def _open(config: RigConfig, wires: Wires, stack: ExitStack, first: int) -> Devices:
    """Enter the devices; the laser last, so that it is the first to be made safe."""
    return Devices(
        galvo=stack.enter_context(GALVOS[config.galvo.kind](config.galvo, wires)),
        spad=stack.enter_context(DETECTORS[config.detector.kind](config.detector, wires)),
        tcspc=stack.enter_context(TIMING[config.tcspc.kind].open(config, wires, first)),
        laser=stack.enter_context(LASERS[config.laser.kind](config.laser, wires)),
        clock=wires.clock,
    )
