"""The composition root: opens the devices that a configuration names, real or simulated at their wires."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivers.clock import SystemClock
from drivers.errors import DeviceNotFoundError
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

    def hhlib() -> HHLib:
        return load_library(config.tcspc.library if isinstance(config.tcspc, HydraHarpConfig) else None)

    with ExitStack() as stack:
        yield Wires(
            galvo=config.galvo.address or "",
            laser=config.laser.address or "",
            usb_backend=stack.enter_context(_served_detector(config)),
            hhlib=stack.enter_context(_served_timing(config)) if config.served else hhlib,
            clock=SystemClock(),
        )


@contextmanager
def _served_detector(config: RigConfig) -> Iterator[object]:
    """Give the USB bus on which the detector is: that of a served one, or None for the system's."""
    address = config.detector.address
    if address is None:
        yield None
        return
    from simulators.wire.served.detector import served_detector

    with ExitStack() as stack:
        try:
            backend = stack.enter_context(served_detector(address))
        except OSError as problem:
            raise _not_served("detector", address, problem) from problem
        yield backend


@contextmanager
def _served_timing(config: RigConfig) -> Iterator[Callable[[], HHLib]]:
    """Give the library of a HydraHarp that is simulated here, on a bench that another process serves."""
    from simulators.wire.hydraharp import HydraHarpSimulator
    from simulators.wire.served.timing import ServedBench

    assert isinstance(config.tcspc, HydraHarpConfig)
    address = config.tcspc.address or ""
    with ExitStack() as stack:
        try:
            bench = stack.enter_context(ServedBench(address))
        except OSError as problem:
            raise _not_served("bench", address, problem) from problem
        faults = bench.faults
        harp = HydraHarpSimulator(bench, timing=faults.timing, count_depth=faults.count_depth)
        yield lambda: HHLib(harp.functions)
        harp.raise_pending()  # inside a C callback an exception is only an error code


def _not_served(what: str, address: str, problem: OSError) -> DeviceNotFoundError:
    return DeviceNotFoundError(
        f"served {what} at {address}",
        "answer",
        f"{problem}",
        "Start rig sim serve, and use the configuration that it writes.",
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
