"""What all C functions share: which instrument is at a device index, and in what state it must be."""

from collections.abc import Mapping

from simulators.wire.harp.codes import Code, Slot
from simulators.wire.harp.exports import require, take
from simulators.wire.harp.families import SimulatedFamily
from simulators.wire.harp.instrument import Instrument


class Connection:
    """The library's device indices, with the instruments connected at the first of them.

    Parameters
    ----------
    family
        Of the library, and so of all its instruments.
    instruments
        The instruments, by their serial numbers.

    Attributes
    ----------
    connected
        Set False to unplug the instruments: none can be opened, and one that is open answers as if it were
        not (unconfirmed; an error of the USB link is as likely).
    busy
        Set True to let another program have the instruments.
    ever_asked
        Whether any index was ever to be opened.
    serials
        The instruments' serial numbers, by index.
    slots
        The state of each device index.
    """

    def __init__(self, family: SimulatedFamily, instruments: Mapping[str, Instrument]) -> None:
        self.family = family
        self.serials = tuple(instruments)
        self._instruments = tuple(instruments.values())
        self.connected = True
        self.busy = False
        self.ever_asked = False
        self.slots = [Slot.CLOSED] * family.devices

    def slot(self, devidx: int) -> Slot:
        """Return the state of an index, or answer that there is no such index."""
        take(0 <= devidx < len(self.slots), 1)
        return self.slots[devidx]

    def opened(self, devidx: int) -> Instrument:
        """Return the instrument at an index, or answer why there is none."""
        slot = self.slot(devidx)
        require(self.ever_asked, Code.INVALID_MEMORY)  # observed: until the first OpenDevice, at any index
        require(slot is Slot.OPEN and self.connected, Code.DEVICE_NOT_OPEN)
        return self._instruments[devidx]

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
