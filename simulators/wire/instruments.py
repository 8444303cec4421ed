"""All simulated instruments on one bench, each at the end of its wire."""

from collections.abc import Callable
from itertools import count
from types import TracebackType
from typing import Self

from simulators.bench import Bench
from simulators.wire.daq import DaqWiring, SimulatedBoard
from simulators.wire.galvo import GalvoBoard
from simulators.wire.harp import HarpSimulator
from simulators.wire.laser import KatanaHead
from simulators.wire.laser_head import LaserHead
from simulators.wire.lines import LineFirmware
from simulators.wire.serial_url.protocol_sim import attach, detach
from simulators.wire.shutter import PortShutter
from simulators.wire.spad import DetectorInstrument, SpadInstrument
from simulators.wire.usb import UsbBackend

_numbers = count(1)


class SimulatedInstruments:
    """The devices of one rig, reachable while entered.

    Parameters
    ----------
    bench
        What they act on.
    laser, detector, delayer, shutter
        Make these devices; None where there is no such one, or it has no data interface. The shutter is one
        on a serial port.
    timing
        Makes the timing instrument.
    wiring
        What hangs on the DAQ board.

    Attributes
    ----------
    galvo_url, laser_url, detector_url, delayer_url, shutter_url
        Addresses for ``serial.serial_for_url``; empty where no such device is on a serial line.
    usb_backend
        Backend for ``usb.core.find``; a detector on USB is its only device.
    detector, delayer, shutter
        The devices that were made.
    harp
        Object with the functions of the timing instrument's library as attributes.
    daq
        The DAQ board.
    """

    def __init__(
        self,
        bench: Bench,
        *,
        laser: Callable[[Bench], LaserHead] | None = KatanaHead,
        detector: Callable[[Bench], DetectorInstrument] | None = SpadInstrument,
        delayer: Callable[[Bench], LineFirmware] | None = None,
        shutter: Callable[[Bench], PortShutter] | None = None,
        timing: Callable[[Bench], HarpSimulator] = HarpSimulator,
        wiring: DaqWiring | None = None,
    ) -> None:
        self._bench = bench
        self._laser = laser
        self._name = f"bench{next(_numbers)}"
        self.detector = detector(bench) if detector else None
        self.delayer = delayer(bench) if delayer else None
        self.shutter = shutter(bench) if shutter else None
        self.usb_backend = UsbBackend([self.detector] if isinstance(self.detector, SpadInstrument) else [])
        self._harp = timing(bench)
        self.harp = self._harp.functions
        self.daq = SimulatedBoard(bench, wiring)

    def __enter__(self) -> Self:
        self.galvo_url = self._plugged_in("galvo", GalvoBoard(self._bench))
        self.laser_url = self._plugged_in("laser", self._laser(self._bench) if self._laser else None)
        self.detector_url = self._plugged_in("detector", self.detector)
        self.delayer_url = self._plugged_in("delayer", self.delayer)
        self.shutter_url = self._plugged_in("shutter", self.shutter)
        return self

    def _plugged_in(self, name: str, device: DetectorInstrument | PortShutter | None) -> str:
        """Plug a device into a serial line of its own, if it has one; return the address."""
        if not isinstance(device, LineFirmware | PortShutter):
            return ""
        return attach(f"{self._name}/{name}", device, self._bench.clock)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        urls = (self.galvo_url, self.laser_url, self.detector_url, self.delayer_url, self.shutter_url)
        for address in urls:
            detach(address)
        self._harp.raise_pending()  # inside a C callback an exception is only an error code
