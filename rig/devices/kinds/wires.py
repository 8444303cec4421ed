"""Where each driver finds its device."""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.daq.board import SharedBoard
from drivers.harp.family import Family
from drivers.harp.library import HarpLibrary
from rig.model.devices import Clock, Operator


@dataclass(frozen=True)
class Wires:
    """Where each driver finds its device.

    Attributes
    ----------
    galvo, laser, detector, delayer, shutter
        Serial ports or pyserial URLs.
    sync_hz, gate_hz
        Sync pulses a second, which come to all that follows the laser; and those for which the gate opens.
    usb_backend
        Of pyusb; None for the system's.
    harp
        Gives the library of a family of timing instruments, when it is needed.
    daq
        Gives the DAQ board of a name: always the same one, so that all devices on it share it.
    clock
        The time that all devices share.
    gate_delayed
        Whether a delayer triggers the detector's gate.
    operator
        Who sets by hand what has no data interface; None where nobody is there.
    """

    galvo: str
    laser: str
    usb_backend: object
    harp: Callable[[Family], HarpLibrary]
    daq: Callable[[str], SharedBoard]
    clock: Clock
    sync_hz: float
    gate_hz: float
    detector: str = ""
    delayer: str = ""
    shutter: str = ""
    gate_delayed: bool = False
    operator: Operator | None = None
