"""What all C functions share: which instrument is at a device index, and in what state it must be."""

from simulators.wire.hydraharp.codes import DEVICES, Code, Slot
from simulators.wire.hydraharp.exports import require
from simulators.wire.hydraharp.instrument import Instrument


class Connection:
    """The library's device indices, with one instrument connected at index 0.

    Parameters
    ----------
    instrument
        The instrument.
    serial
        Its serial number.
    sync_period_unit_s
        Unit of `HH_GetSyncPeriod`.

    Attributes
    ----------
    connected
        Set False to unplug the instrument before it is opened.
    busy
        Set True to let another program have the instrument.
    slots
        The state of each device index.
    """

    def __init__(self, instrument: Instrument, serial: str, sync_period_unit_s: float) -> None:
        self.instrument = instrument
        self.serial = serial
        self.sync_period_unit_s = sync_period_unit_s
        self.connected = True
        self.busy = False
        self.slots = [Slot.UNTOUCHED] * DEVICES

    def slot(self, devidx: int) -> Slot:
        """Return the state of an index, or answer that there is no such index."""
        require(0 <= devidx < DEVICES)
        return self.slots[devidx]

    def opened(self, devidx: int) -> Instrument:
        """Return the instrument at an index, or answer why there is none."""
        slot = self.slot(devidx)
        require(slot is not Slot.UNTOUCHED, Code.INVALID_MEMORY)
        require(slot is Slot.OPEN, Code.DEVICE_NOT_OPEN)
        return self.instrument

    def initialized(self, devidx: int) -> Instrument:
        """Return the instrument at an index if it is open and initialised."""
        instrument = self.opened(devidx)
        require(instrument.initialized, Code.NOT_INITIALIZED)
        return instrument

    def idle(self, devidx: int) -> Instrument:
        """Return the instrument at an index if it is initialised and not between StartMeas and StopMeas."""
        instrument = self.initialized(devidx)
        require(not instrument.running, Code.INSTANCE_RUNNING)
        return instrument
