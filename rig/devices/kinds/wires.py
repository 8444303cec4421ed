"""Where each driver finds its device."""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.daq.board import SharedBoard
from drivers.hydraharp.library import HHLib
from rig.model.devices import Clock, Operator


@dataclass(frozen=True)
class Wires:
    """Where each driver finds its device.

    Attributes
    ----------
    galvo, laser, detector, delayer, shutter
        Serial ports or pyserial URLs.
    sync_hz
        Sync pulses a second, which come to all that follows the laser.
    usb_backend
        Of pyusb; None for the system's.
    hhlib
        Gives the HydraHarp's library, when it is needed.
    daq
        Gives the DAQ board of a name: always the same one, so that all devices on it share it.
    clock
        The time that all devices share.
    operator
        Who sets by hand what has no data interface; None where nobody is there.
    """

    galvo: str
    laser: str
    usb_backend: object
    hhlib: Callable[[], HHLib]
    daq: Callable[[str], SharedBoard]
    clock: Clock
    sync_hz: float
    detector: str = ""
    delayer: str = ""
    shutter: str = ""
    operator: Operator | None = None
