"""A tiny scan in this process, on a bench whose wires have taps, judged by the bench's physical state."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attacks.serial_url import protocol_attacked
from attacks.taps import Tap, TappedLibrary, TappedUsb
from drivers.daq.board import SharedBoard
from drivers.harp.library import HarpLibrary
from rig.__main__ import exit_code, told
from rig.acquire.acquisition import Watch, record
from rig.acquire.connect import devices_on
from rig.acquire.events import Event, Outcome
from rig.bench.gates import detector_head, gate_delayer
from rig.bench.simulated import laser_head, simulated_bench
from rig.devices.kinds import Wires
from rig.files.scan import ScanFile
from rig.model.config import RigConfig, built_in_with
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from simulators.bench import Bench
from simulators.clock import BenchClock
from simulators.wire.daq import SimulatedBoard
from simulators.wire.galvo import GalvoBoard
from simulators.wire.harp import HarpSimulator
from simulators.wire.laser_head import LaserHead
from simulators.wire.lines import LineFirmware
from simulators.wire.spad import DetectorInstrument, SpadInstrument

_numbers = count(1)


def tiny_config(changes: dict | None = None) -> RigConfig:
    """Return the built-in simulated rig with short histograms."""
    tiny = {"tcspc": {"kind": "hydraharp", "bins": 1500, "bin_width": "32ps"}, "calibration": {"use": False}}
    return built_in_with(tiny | (changes or {}))


def tiny_plan(config: RigConfig, columns: int = 4, rows: int = 3, exposure_s: float = 1e-3) -> ScanPlan:
    """Return a plan of few short exposures."""
    return ScanPlan.grid(config, columns=columns, rows=rows, spacing_m=0.1, exposure_s=exposure_s, skip_m=0.0)


@dataclass
class AttackedRig:
    """A simulated rig: the bench, and the devices behind its wires as they are, to be broken by a test."""

    bench: Bench
    galvo: GalvoBoard
    laser: LaserHead
    spad: DetectorInstrument
    delayer: LineFirmware | None
    harp: HarpSimulator
    usb: TappedUsb
    wires: Wires
    addresses: dict[str, str]

    def unplug(self, name: str) -> None:
        """Pull a plug: ``galvo``, ``laser``, ``spad`` or ``delayer``."""
        if name == "spad" and isinstance(self.spad, SpadInstrument):
            self.usb.unplug(self.spad)
        else:
            protocol_attacked.detach(self.addresses[name])


@contextmanager
def attacked_rig(
    config: RigConfig, tap: Tap | None = None, *, real_time: bool = False
) -> Iterator[AttackedRig]:
    """Build a rig with taps in its wires; what its scene sends back is rendered once."""
    tap = tap or Tap()
    rendered = simulated_bench_of(config)
    clock = BenchClock(real_time=real_time)
    bench = Bench(rendered.photons, rendered.geometry, seed=rendered.seed, clock=clock)
    galvo, laser = GalvoBoard(bench), laser_head(config)(bench)
    head, delays = detector_head(config), gate_delayer(config)
    assert head is not None
    spad, delayer = head(bench), delays(bench) if delays else None
    harp = HarpSimulator(bench)
    usb = TappedUsb([spad] if isinstance(spad, SpadInstrument) else [], tap)
    name = str(next(_numbers))
    addresses = {
        device: protocol_attacked.attach(name, device, firmware, bench.clock, tap)
        for device, firmware in (("galvo", galvo), ("laser", laser), ("spad", spad), ("delayer", delayer))
        if isinstance(firmware, LineFirmware)
    }
    library = TappedLibrary(harp.functions, tap)
    board = SharedBoard(SimulatedBoard(bench))
    wires = Wires(
        galvo=addresses["galvo"],
        laser=addresses["laser"],
        detector=addresses.get("spad", ""),
        delayer=addresses.get("delayer", ""),
        usb_backend=usb,
        harp=partial(HarpLibrary, library),
        daq=lambda _: board,
        clock=bench.clock,
        sync_hz=config.laser.repetition_hz,
        gate_hz=config.gate_hz,
    )
    try:
        yield AttackedRig(bench, galvo, laser, spad, delayer, harp, usb, wires, addresses)
    finally:
        for address in addresses.values():
            protocol_attacked.detach(address)


_rendered: dict[str, Bench] = {}


def simulated_bench_of(config: RigConfig) -> Bench:
    """Return a bench whose physics are as configured; its state is not to be used."""
    key = config.model_dump_json()
    if key not in _rendered:
        _rendered[key] = simulated_bench(config, real_time=False)
    return _rendered[key]


@dataclass(frozen=True)
class End:
    """How a scan ended.

    Attributes
    ----------
    code
        The exit code that the command line gives it; 1 is a defect, 130 an interrupt.
    error
        The kind of error, empty for none.
    said
        What a person reads: the message, and what was noticed.
    emitting, sensitive
        The bench's state: whether light leaves the laser, whether the detector detects any.
    """

    code: int
    error: str
    said: str
    emitting: bool
    sensitive: bool


def scan(
    rig: AttackedRig,
    config: RigConfig,
    plan: ScanPlan,
    target: Path,
    consumers: Sequence[Callable[[Event], None]] = (),
) -> End:
    """Run a scan on a rig, and judge it as the command line does."""
    state = RigState(config)
    code, kind, said = 0, "", ""
    try:
        with devices_on(config, rig.wires) as devices:
            result = record(plan, state.of_devices(devices.identities()), devices, target, Watch(consumers))
        code = 0 if result.ended.outcome is Outcome.COMPLETE else 6
    except KeyboardInterrupt as interrupt:
        code, kind, said = 130, "KeyboardInterrupt", told(interrupt)
    except Exception as error:
        code, kind, said = exit_code(error) or 1, type(error).__name__, told(error)
    light = rig.bench.light
    return End(code, kind, said, light.emitting, light.sensitive)


@dataclass(frozen=True)
class Kept:
    """What a scan file holds: status, warnings, counts (positions, bins) and which are measured."""

    status: str
    warnings: tuple[str, ...]
    counts: NDArray[np.uint32]
    done: NDArray[np.bool_]


def kept(path: Path) -> Kept:
    """Read a scan file."""
    with ScanFile(path) as file:
        counts = np.asarray(file.counts(range(file.steps)))
        return Kept(file.status, tuple(file.warnings), counts.reshape(file.steps, -1), file.done.copy())
