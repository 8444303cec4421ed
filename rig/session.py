"""The composition root: opens the devices that a configuration names, real or simulated at their wires."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from drivers.clock import SystemClock
from drivers.galvo import OptotuneMirror
from drivers.hydraharp import HHLib, HydraHarp, load_library
from drivers.laser import KatanaLaser
from drivers.spad import Id120Spad
from rig.config import RigConfig, SimulationConfig
from rig.devices import Clock
from rig.engine import Devices
from rig.errors import ConfigError


@contextmanager
def open_devices(config: RigConfig) -> Iterator[Devices]:
    """Open and identify all devices; leave all of them safe at the end, the laser first.

    Raises
    ------
    drivers.errors.DeviceError
        If a device is missing, is another one, or fails.
    """
    with ExitStack() as stack:
        if config.simulated:
            wires = stack.enter_context(_simulated(config))
        else:
            wires = _Wires(
                galvo=config.galvo.address or "",
                laser=config.laser.address or "",
                usb_backend=None,
                hhlib=load_library(config.hydraharp.library),
                clock=SystemClock(),
            )
        yield _open(config, wires, stack)


@dataclass(frozen=True)
class _Wires:
    """Where each driver finds its device."""

    galvo: str
    laser: str
    usb_backend: object
    hhlib: HHLib
    clock: Clock


@contextmanager
def _simulated(config: RigConfig) -> Iterator[_Wires]:
    """Build the simulated bench and put its devices at the ends of the wires."""
    from simulators.bench import Bench, BenchGeometry
    from simulators.clock import BenchClock
    from simulators.photons import Detector, HiddenScenePhotons, Optics
    from simulators.scenes import scene
    from simulators.wire.rack import Rack

    simulation = config.simulation or SimulationConfig()
    geometry = BenchGeometry(
        galvo_m=config.galvo.position_m,
        detector_head_m=config.spad.position_m,
        detector_spot_m=config.spad.spot_m,
        electronics_delay_s=config.timing.electronics_delay_s,
    )
    try:
        hidden = scene(simulation.scene)
    except (ValueError, ModuleNotFoundError) as error:
        raise ConfigError(f"simulation.scene: {error}") from None
    if simulation.roughness is not None:
        hidden = hidden.with_roughness(simulation.roughness)
    photons = HiddenScenePhotons(hidden, geometry, Optics(), Detector(), bounces=simulation.bounces)
    clock = BenchClock(real_time=simulation.real_time)
    with Rack(Bench(photons, geometry, seed=simulation.seed, clock=clock)) as rack:
        yield _Wires(
            galvo=rack.galvo_url,
            laser=rack.laser_url,
            usb_backend=rack.usb_backend,
            hhlib=HHLib(rack.hhlib),
            clock=clock,
        )


def _open(config: RigConfig, wires: _Wires, stack: ExitStack) -> Devices:
    """Enter the devices; the laser last, so that it is the first to be made safe."""
    galvo = stack.enter_context(
        OptotuneMirror(
            wires.galvo,
            clock=wires.clock,
            max_angle_rad=(config.galvo.max_angle_x_rad, config.galvo.max_angle_y_rad),
        )
    )
    spad = stack.enter_context(
        Id120Spad(
            serial=config.spad.serial,
            backend=wires.usb_backend,
            clock=wires.clock,
            gated=config.spad.gated,
            gate_delay_s=config.spad.gate_delay_s,
            gate_width_s=config.spad.gate_width_s,
            hold_off_s=config.spad.hold_off_s,
            excess_bias_v=config.spad.excess_bias_v,
        )
    )
    harp = config.hydraharp
    tcspc = stack.enter_context(
        HydraHarp(
            wires.hhlib,
            clock=wires.clock,
            serial=harp.serial,
            sync_divider=harp.sync_divider,
            sync_cfd_mv=(round(harp.sync_level_v * 1e3), round(harp.sync_zero_cross_v * 1e3)),
            input_channel=harp.input_channel,
            input_cfd_mv=(round(harp.input_level_v * 1e3), round(harp.input_zero_cross_v * 1e3)),
            bin_width_s=harp.bin_width_s,
            bins=harp.bins,
            offset_s=harp.offset_s,
        )
    )
    laser = stack.enter_context(
        KatanaLaser(
            wires.laser,
            clock=wires.clock,
            power_setpoint=config.laser.power_setpoint,
            repetition_hz=config.laser.repetition_hz,
        )
    )
    return Devices(galvo=galvo, laser=laser, spad=spad, tcspc=tcspc, clock=wires.clock)
