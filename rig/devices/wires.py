"""The wires of a rig whose devices have addresses: real ones, or served by another process."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cache, partial

from drivers.clock import Clock, SystemClock
from drivers.daq.board import SharedBoard
from drivers.daq.nidaqmx_board import NidaqmxBoard
from drivers.harp.library import HarpLibrary
from drivers.harp.loading import load_library
from rig.bench.reached import board_at, detector_at, timing_at
from rig.devices.delayed_gate import open_detector
from rig.devices.kinds import Wires
from rig.devices.shuttered import open_laser
from rig.model.config import DaqClockConfig, DaqShutterConfig, HarpConfig, Id120Config, RigConfig
from rig.model.devices import GatedSpad, Laser, Operator


@contextmanager
def wires_by_address(config: RigConfig, operator: Operator | None = None) -> Iterator[Wires]:
    """Reach each device where the configuration says that it is; none is opened yet."""
    harp = config.tcspc
    with ExitStack() as stack:
        wires = replace(_wires(config), operator=operator)
        wires = stack.enter_context(_detector_wires(config, wires))
        if isinstance(harp, HarpConfig) and harp.address:
            functions = stack.enter_context(timing_at(harp.address, harp))
            wires = replace(wires, harp=partial(HarpLibrary, functions))
        served = {
            device: stack.enter_context(board_at(address))
            for device, address in config.boards.items()
            if address
        }
        here = wires.daq
        yield replace(wires, daq=lambda device: served[device] if device in served else here(device))


@contextmanager
def laser_by_address(config: RigConfig, clock: Clock | None = None) -> Iterator[Laser]:
    """Open the laser alone, with the shutter in its beam."""
    wires, shutter = _wires(config, clock), config.shutter
    with ExitStack() as stack:
        if isinstance(shutter, DaqShutterConfig) and shutter.address:
            board = stack.enter_context(board_at(shutter.address))
            wires = replace(wires, daq=lambda device: board)
        yield stack.enter_context(open_laser(config, wires))


@contextmanager
def detector_by_address(config: RigConfig) -> Iterator[GatedSpad]:
    """Open the detector alone, with the delayer of its gate."""
    with _detector_wires(config, _wires(config)) as wires, open_detector(config, wires) as detector:
        yield detector


@contextmanager
def _detector_wires(config: RigConfig, wires: Wires) -> Iterator[Wires]:
    """Reach a served detector that is on USB."""
    if isinstance(config.detector, Id120Config) and config.detector.address:
        with detector_at(config.detector.address) as backend:
            yield replace(wires, usb_backend=backend)
    else:
        yield wires


def _wires(config: RigConfig, clock: Clock | None = None) -> Wires:
    library = config.tcspc.library if isinstance(config.tcspc, HarpConfig) else None
    counter = config.point_clock.counter if isinstance(config.point_clock, DaqClockConfig) else ""

    @cache
    def daq(device: str) -> SharedBoard:
        return SharedBoard(NidaqmxBoard(device, counter=counter))

    return Wires(
        galvo=config.serial_addresses.get("galvo") or "",
        laser=config.laser.address or "",
        usb_backend=None,
        harp=partial(load_library, path=library),
        daq=daq,
        clock=clock or SystemClock(),
        sync_hz=config.laser.repetition_hz,
        gate_hz=config.gate_hz,
        detector=config.detector.address or "",
        delayer=(config.delayer.address if config.delayer else None) or "",
        shutter=(config.shutter.address if config.shutter else None) or "",
    )
