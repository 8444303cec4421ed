"""The composition root: opens the devices that a configuration names, real or simulated at their wires."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivers.clock import SystemClock
from drivers.hydraharp.device import HydraHarp
from drivers.hydraharp.library import HHLib
from drivers.hydraharp.loading import load_library
from drivers.hydraharp.settings import HydraHarpSettings
from drivers.id120 import Id120Settings, Id120Spad
from drivers.katana.laser import KatanaLaser
from drivers.katana.settings import KatanaSettings
from drivers.optotune import OptotuneLimits, OptotuneMirror
from drivers.video_camera import VideoCamera
from rig.acquire.engine import Devices
from rig.model.config import RigConfig
from rig.model.devices import Clock, Operator, WallCamera

if TYPE_CHECKING:
    from simulators.bench import Bench


@dataclass(frozen=True)
class Station:
    """A whole rig for calibration: devices, the person at it, and the cameras that see the wall."""

    devices: Devices
    operator: Operator
    cameras: tuple[WallCamera, ...]


@contextmanager
def open_devices(config: RigConfig) -> Iterator[Devices]:
    """Open and identify all devices; leave all of them safe at the end, the laser first.

    Raises
    ------
    drivers.errors.DeviceError
        If a device is missing, is another one, or fails.
    """
    with ExitStack() as stack:
        wires = stack.enter_context(_simulated(config))[0] if config.simulated else _real(config)
        yield _open(config, wires, stack)


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
        yield Station(_open(config, wires, stack), operator, cameras)


@dataclass(frozen=True)
class _Wires:
    """Where each driver finds its device."""

    galvo: str
    laser: str
    usb_backend: object
    hhlib: HHLib
    clock: Clock


def _real(config: RigConfig) -> _Wires:
    return _Wires(
        galvo=config.galvo.address or "",
        laser=config.laser.address or "",
        usb_backend=None,
        hhlib=load_library(config.hydraharp.library),
        clock=SystemClock(),
    )


@contextmanager
def _simulated(config: RigConfig) -> "Iterator[tuple[_Wires, Bench]]":
    """Build the simulated bench and put its devices at the ends of the wires."""
    from rig.bench.simulated import rack as build

    bench, rack = build(config)
    with rack:
        yield (
            _Wires(
                galvo=rack.galvo_url,
                laser=rack.laser_url,
                usb_backend=rack.usb_backend,
                hhlib=HHLib(rack.hhlib),
                clock=bench.clock,
            ),
            bench,
        )


def _open(config: RigConfig, wires: _Wires, stack: ExitStack) -> Devices:
    """Enter the devices; the laser last, so that it is the first to be made safe."""
    galvo = stack.enter_context(
        OptotuneMirror(
            wires.galvo,
            clock=wires.clock,
            limits=OptotuneLimits((config.galvo.max_angle_x_rad, config.galvo.max_angle_y_rad)),
        )
    )
    spad = stack.enter_context(
        Id120Spad(
            serial=config.spad.serial,
            backend=wires.usb_backend,
            clock=wires.clock,
            settings=Id120Settings(
                gated=config.spad.gated,
                gate_delay_s=config.spad.gate_delay_s,
                gate_width_s=config.spad.gate_width_s,
                hold_off_s=config.spad.hold_off_s,
                excess_bias_v=config.spad.excess_bias_v,
            ),
        )
    )
    harp = config.hydraharp
    tcspc = stack.enter_context(
        HydraHarp(
            wires.hhlib,
            clock=wires.clock,
            serial=harp.serial,
            settings=HydraHarpSettings(
                inputs=(harp.input_channel,),
                input_level_v=harp.input_level_v,
                input_zero_cross_v=harp.input_zero_cross_v,
                sync_level_v=harp.sync_level_v,
                sync_zero_cross_v=harp.sync_zero_cross_v,
                sync_divider=harp.sync_divider,
                bin_width_s=harp.bin_width_s,
                bins=harp.bins,
                offset_s=harp.offset_s,
            ),
        )
    )
    laser = stack.enter_context(
        KatanaLaser(
            wires.laser,
            clock=wires.clock,
            settings=KatanaSettings(
                power_setpoint=config.laser.power_setpoint, repetition_hz=config.laser.repetition_hz
            ),
        )
    )
    return Devices(galvo=galvo, laser=laser, spad=spad, tcspc=tcspc, clock=wires.clock)
