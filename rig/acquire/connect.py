"""The composition root: opens the devices that a configuration names, real or simulated at their wires."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
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
        wires = stack.enter_context(_simulated(config))[0] if config.simulated else _real(config)
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
            from rig.bench.operator import stand_ins

            operator, cameras = stand_ins(bench)
        else:
            wires = _real(config)
            cameras = tuple(stack.enter_context(VideoCamera(one)) for one in config.cameras.addresses)
        yield Station(_open(config, wires, stack, 0), operator, cameras)


def _real(config: RigConfig) -> Wires:
    def hhlib() -> HHLib:
        return load_library(config.tcspc.library if isinstance(config.tcspc, HydraHarpConfig) else None)

    return Wires(
        galvo=config.galvo.address or "",
        laser=config.laser.address or "",
        usb_backend=None,
        hhlib=hhlib,
        clock=SystemClock(),
    )


@contextmanager
def _simulated(config: RigConfig) -> "Iterator[tuple[Wires, Bench]]":
    """Build the simulated bench and put its devices at the ends of the wires."""
    from rig.bench.simulated import rack as build

    bench, rack = build(config)
    with rack:
        yield (
            Wires(
                galvo=rack.galvo_url,
                laser=rack.laser_url,
                usb_backend=rack.usb_backend,
                hhlib=lambda: HHLib(rack.hhlib),
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
