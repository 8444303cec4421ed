"""The wires of a rig whose devices have addresses: real ones, or served by another process."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import replace
from functools import cache, partial

from drivers.clock import Clock, SystemClock
from drivers.daq.board import SharedBoard
from drivers.daq.nidaqmx_board import NidaqmxBoard
from drivers.harp.library import HarpLibrary
from drivers.harp.loading import load_library
from rig.bench.reached import board_at, detector_at, timing_at
from rig.devices.kinds import DETECTORS, LASERS, Wires
from rig.model.config import DaqClockConfig, HarpConfig, RigConfig
from rig.model.devices import GatedSpad, Laser


@contextmanager
def wires_by_address(config: RigConfig) -> Iterator[Wires]:
    """Reach each device where the configuration says that it is; none is opened yet."""
    harp = config.tcspc
    with ExitStack() as stack:
        wires = _wires(config)
        if config.detector.address:
            wires = replace(wires, usb_backend=stack.enter_context(detector_at(config.detector.address)))
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


def laser_by_address(config: RigConfig, clock: Clock | None = None) -> AbstractContextManager[Laser]:
    """Return the laser alone, to be entered."""
    return LASERS.of(config.laser).open(config.laser, _wires(config, clock))


@contextmanager
def detector_by_address(config: RigConfig) -> Iterator[GatedSpad]:
    """Open the detector alone."""
    detector, wires = config.detector, _wires(config)
    with ExitStack() as stack:
        if detector.address:
            wires = replace(wires, usb_backend=stack.enter_context(detector_at(detector.address)))
        yield stack.enter_context(DETECTORS.of(detector).open(detector, wires))


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
    )
