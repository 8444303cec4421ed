"""All simulated instruments on one bench, each at the end of its wire."""

from collections.abc import Callable
from itertools import count
from types import TracebackType
from typing import Self

from simulators.bench import Bench
from simulators.wire.daq import DaqWiring, SimulatedBoard
from simulators.wire.galvo import GalvoBoard
from simulators.wire.harp import HarpSimulator, SimulatedFamily, Timing
from simulators.wire.harp.families import HYDRAHARP
from simulators.wire.laser import KatanaHead
from simulators.wire.laser_head import LaserHead
from simulators.wire.serial_url.protocol_sim import attach, detach
from simulators.wire.spad import SpadInstrument
from simulators.wire.usb import UsbBackend

_numbers = count(1)


class SimulatedInstruments:
    """The devices of one rig, reachable while entered.

    Parameters
    ----------
    bench
        What they act on.
    laser
        Makes the laser.
    timing, count_depth
        Faults of the timing instrument's clock, and the largest count of its bins.
    family
        What the timing instrument is.
    wiring
        What hangs on the DAQ board.

    Attributes
    ----------
    galvo_url, laser_url
        Addresses for ``serial.serial_for_url``.
    usb_backend
        Backend for ``usb.core.find``; the detector is its only device.
    harp
        Object with the functions of the timing instrument's library as attributes.
    daq
        The DAQ board.
    """

    def __init__(
        self,
        bench: Bench,
        *,
        laser: Callable[[Bench], LaserHead] = KatanaHead,
        timing: Timing | None = None,
        count_depth: int = 2**32 - 1,
        family: SimulatedFamily = HYDRAHARP,
        wiring: DaqWiring | None = None,
    ) -> None:
        self._bench = bench
        self._laser = laser
        self._name = f"bench{next(_numbers)}"
        self.usb_backend = UsbBackend([SpadInstrument(bench)])
        self._harp = HarpSimulator(bench, family, timing=timing, count_depth=count_depth)
        self.harp = self._harp.functions
        self.daq = SimulatedBoard(bench, wiring)

    def __enter__(self) -> Self:
        clock = self._bench.clock
        self.galvo_url = attach(f"{self._name}/galvo", GalvoBoard(self._bench), clock)
        self.laser_url = attach(f"{self._name}/laser", self._laser(self._bench), clock)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        detach(self.galvo_url)
        detach(self.laser_url)
        self._harp.raise_pending()  # inside a C callback an exception is only an error code
