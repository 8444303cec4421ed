"""The wires of a rig whose devices have addresses: real ones, or served by another process."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import replace
from functools import cache, partial

from drivers.clock import Clock, SystemClock
from drivers.daq.board import SharedBoard
from drivers.daq.nidaqmx_board import NidaqmxBoard
from drivers.harp.families import HYDRAHARP_400
from drivers.harp.library import HarpLibrary
from drivers.harp.loading import load_library
from rig.bench.reached import board_at, detector_at, timing_at
from rig.devices.kinds import DETECTORS, LASERS, Wires
from rig.model.config import HydraHarpConfig, RigConfig
from rig.model.devices import GatedSpad, Laser


@contextmanager
def wires_by_address(config: RigConfig) -> Iterator[Wires]:
    """Reach each device where the configuration says that it is; none is opened yet."""
    harp = config.tcspc
    with ExitStack() as stack:
        wires = _wires(config)
        if config.detector.address:
            wires = replace(wires, usb_backend=stack.enter_context(detector_at(config.detector.address)))
        if isinstance(harp, HydraHarpConfig) and harp.address:
            functions = stack.enter_context(timing_at(harp.address))
            wires = replace(wires, harp=partial(HarpLibrary, functions, HYDRAHARP_400))
        served = {
            device: stack.enter_context(board_at(address))
            for device, address in config.boards.items()
            if address
        }
        here = wires.daq
        yield replace(wires, daq=lambda device: served[device] if device in served else here(device))


def laser_by_address(config: RigConfig, clock: Clock | None = None) -> AbstractContextManager[Laser]:
    """Return the laser alone, to be entered."""
    return LASERS[config.laser.kind](config.laser, _wires(config, clock))


@contextmanager
def detector_by_address(config: RigConfig) -> Iterator[GatedSpad]:
    """Open the detector alone."""
    detector, wires = config.detector, _wires(config)
    with ExitStack() as stack:
        if detector.address:
            wires = replace(wires, usb_backend=stack.enter_context(detector_at(detector.address)))
        yield stack.enter_context(DETECTORS[detector.kind](detector, wires))


def _wires(config: RigConfig, clock: Clock | None = None) -> Wires:
    library = config.tcspc.library if isinstance(config.tcspc, HydraHarpConfig) else None
    harp: Callable[[], HarpLibrary] = partial(load_library, HYDRAHARP_400, library)
    counter = config.point_clock.counter if config.point_clock else ""

    @cache
    def daq(device: str) -> SharedBoard:
        return SharedBoard(NidaqmxBoard(device, counter=counter))

    return Wires(
        galvo=config.serial_addresses.get("galvo") or "",
        laser=config.laser.address or "",
        usb_backend=None,
        harp=harp,
        daq=daq,
        clock=clock or SystemClock(),
    )
