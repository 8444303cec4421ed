"""The wires of instruments that are simulated in this process."""

from functools import partial

from drivers.daq.board import SharedBoard
from drivers.harp.library import HarpLibrary
from rig.devices.kinds import Wires
from rig.model.config import RigConfig
from simulators.bench import Bench
from simulators.wire.instruments import SimulatedInstruments


def wires_to(config: RigConfig, bench: Bench, instruments: SimulatedInstruments) -> Wires:
    """Return where the drivers find instruments that were entered."""
    board = SharedBoard(instruments.daq)
    return Wires(
        galvo=instruments.galvo_url,
        laser=instruments.laser_url,
        detector=instruments.detector_url,
        delayer=instruments.delayer_url,
        usb_backend=instruments.usb_backend,
        harp=partial(HarpLibrary, instruments.harp),
        daq=lambda device: board,
        clock=bench.clock,
        sync_hz=config.laser.repetition_hz,
        gate_hz=config.gate_hz,
    )
