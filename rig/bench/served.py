"""The simulated bench in a process of its own, with devices that other programs open."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rig.bench.gates import detector_head, gate_delayer
from rig.bench.simulated import daq_wiring, laser_head, simulated_bench, timing_faults
from rig.errors import UsageError
from rig.model.config import (
    AnalogueGalvoConfig,
    DaqShutterConfig,
    DetectorConfig,
    ExternalDetectorConfig,
    ExternalLaserConfig,
    HarpConfig,
    RigConfig,
    SerialShutterConfig,
    SimulationConfig,
)

if TYPE_CHECKING:
    from simulators.wire.served.server import Addresses, BenchServer


@contextmanager
def served(config: RigConfig, log: Path | None = None) -> "Iterator[BenchServer]":
    """Build the simulated bench and put its devices where other programs find them.

    Its clock runs in real time. Nothing is answered before `BenchServer.run` is called.

    Parameters
    ----------
    config
        A simulated rig.
    log
        A file to which each change of emission, power, bias and mirror is appended, see
        `simulators.wire.served.change_log.ChangeLog`.

    Raises
    ------
    UsageError
        If the log cannot be written, now or later.
    rig.errors.ConfigError
        If there is no such scene, or it cannot be made as bright as wanted.
    """
    from simulators.wire.served.change_log import ChangeLog
    from simulators.wire.served.server import BenchServer
    from simulators.wire.served.timing import TimingFaults

    with ExitStack() as stack:
        write = stack.enter_context(_appending(log)) if log else None
        if isinstance(config.shutter, SerialShutterConfig):
            raise UsageError("a pseudo-terminal has no RTS or DTR: serve a shutter of kind 'daq'")
        bench = simulated_bench(config, real_time=True)
        if isinstance(config.laser, ExternalLaserConfig):  # nobody is at this bench to switch it
            bench.change_light(emitting=True)
        if isinstance(config.detector, ExternalDetectorConfig):
            bench.change_light(biased=True, **_gate_of(config.detector))
        bench.warm_up()
        faults = TimingFaults(
            timing_faults(config), (config.simulation or SimulationConfig()).faults.largest_count
        )
        server = stack.enter_context(
            BenchServer(
                bench,
                faults,
                daq_wiring(config),
                laser=laser_head(config),
                detector=detector_head(config),
                delayer=gate_delayer(config),
            )
        )
        if write:
            ChangeLog(bench, write)
        yield server


def _gate_of(detector: DetectorConfig) -> dict[str, bool | float]:
    """Return how a detector is gated, as a person has set it."""
    return {
        "gated": detector.gated,
        "gate_delay_s": detector.gate_delay_s,
        "gate_width_s": detector.gate_width_s,
        "hold_off_s": detector.hold_off_s,
    }


@contextmanager
def _appending(log: Path) -> Iterator[Callable[[str], None]]:
    """Give what appends a line to a file, at once; both raise UsageError where that is not possible."""

    def failed(problem: OSError) -> UsageError:
        return UsageError(
            f"{log} cannot be written ({problem.strerror}); free some space or give another --log"
        )

    def write(line: str) -> None:
        try:
            file.write(line.encode("ascii"))
        except OSError as problem:
            raise failed(problem) from None

    try:
        file = log.open("ab", buffering=0)
    except OSError as problem:
        raise failed(problem) from None
    with file:
        yield write


def configuration(config: RigConfig, addresses: "Addresses") -> RigConfig:
    """Return the configuration with which the served devices of ``config`` are scanned.

    It has no simulation: for a program that scans, galvo and laser are devices at addresses as real ones are,
    and are guarded as such.
    """
    places = {"galvo": addresses.galvo, "laser": addresses.laser, "detector": addresses.detector}
    if isinstance(config.shutter, DaqShutterConfig):
        places["shutter"] = addresses.timing
    if config.delayer is not None and addresses.delayer is not None:
        places["delayer"] = addresses.delayer
    if isinstance(config.galvo, AnalogueGalvoConfig):
        places["galvo"] = addresses.timing  # the board's, too
    if config.point_clock is not None:
        places["point_clock"] = addresses.timing
    if isinstance(config.tcspc, HarpConfig):  # a file that is played needs no bench
        places["tcspc"] = addresses.timing
    sections = {name: getattr(config, name).model_copy(update={"address": at}) for name, at in places.items()}
    return config.model_copy(update={**sections, "simulation": None})
