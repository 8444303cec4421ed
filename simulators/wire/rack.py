"""All simulated devices on one bench, each at the end of its wire."""

from contextlib import ExitStack
from itertools import count
from types import TracebackType
from typing import Self

from simulators.bench import Bench
from simulators.wire.galvo import GalvoBoard
from simulators.wire.hydraharp import HydraHarpSimulator
from simulators.wire.laser import KatanaHead
from simulators.wire.serial_url import attached
from simulators.wire.spad import SpadInstrument
from simulators.wire.usb import UsbBackend

_numbers = count(1)


class Rack:
    """The devices of one rig, reachable while entered.

    Attributes
    ----------
    galvo_url, laser_url
        Addresses for ``serial.serial_for_url``.
    usb_backend
        Backend for ``usb.core.find``; the detector is its only device.
    hhlib
        Object with the 44 HHLib functions as attributes.
    """

    def __init__(self, bench: Bench) -> None:
        name = f"bench{next(_numbers)}"
        self.galvo_url = f"sim://{name}/galvo"
        self.laser_url = f"sim://{name}/laser"
        self.usb_backend = UsbBackend([SpadInstrument(bench)])
        self._harp = HydraHarpSimulator(bench)
        self.hhlib = self._harp.functions
        self._boards = {self.galvo_url: GalvoBoard(bench), self.laser_url: KatanaHead(bench)}
        self._attached = ExitStack()

    def __enter__(self) -> Self:
        for url, board in self._boards.items():
            self._attached.enter_context(attached(url, board))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._attached.close()
        self._harp.raise_pending()  # inside a C callback an exception is only an error code
