"""The simulated library: its C functions, and whether its one instrument is open."""

from types import SimpleNamespace

from simulators.bench import Bench
from simulators.wire.hydraharp import information, measuring, setting
from simulators.wire.hydraharp.codes import DEVICES, Code, Slot
from simulators.wire.hydraharp.exports import Exports, as_c_functions, require
from simulators.wire.hydraharp.instrument import Instrument
from simulators.wire.hydraharp.timing import Timing


class HydraHarpSimulator:
    """HHLib 3.0 with one HydraHarp connected, at index 0.

    Parameters
    ----------
    bench
        The optical bench that it measures; each detector channel is connected to its input.
    serial
        Serial number, at most 7 characters.
    inputs
        Number of inputs; by default 2, or as many as the detector needs. A real HydraHarp has 8 at most
        (MAXINPCHAN of its header); the simulated one takes more, so that a detector of many pixels fits.
    count_depth
        Largest count of a bin: 2**32 - 1 in the instrument. 65535 gives the saturation of 16-bit data.
    timing
        Faults of its clock; by default none.
    sync_period_unit_s
        Unit of `HH_GetSyncPeriod`: 1.0 as the vendor's C demo takes it, or 1e-12 as the manual says. Which of
        the two a real instrument gives is unconfirmed.

    Attributes
    ----------
    functions
        An object with the 44 C functions as attributes.
    connected
        Set False to unplug the instrument before it is opened.
    busy
        Set True to let another program have the instrument.
    """

    def __init__(
        self,
        bench: Bench,
        *,
        serial: str = "1000001",
        inputs: int | None = None,
        count_depth: int = 2**32 - 1,
        timing: Timing | None = None,
        sync_period_unit_s: float = 1.0,
    ) -> None:
        if len(serial) > 7:
            raise ValueError(f"serial {serial!r} is longer than 7 characters")
        needed = 1 + max((channel.input for channel in bench.geometry.channels), default=0)
        inputs = max(needed, 2) if inputs is None else inputs
        if inputs < needed:
            raise ValueError(f"the detector is connected to input {needed - 1}, but there are only {inputs}")
        self.serial = serial
        self.sync_period_unit_s = sync_period_unit_s
        self.connected = True
        self.busy = False
        self.instrument = Instrument(bench, inputs, count_depth, timing or Timing())
        self.slots = [Slot.UNTOUCHED] * DEVICES
        self._pending: list[BaseException] = []
        exports = Exports([*information.EXPORTS, *setting.EXPORTS, *measuring.EXPORTS])
        self.functions: SimpleNamespace = as_c_functions(exports, self, self._pending.append)

    def raise_pending(self) -> None:
        """Raise the first exception that a function has swallowed since the last call of this method."""
        if self._pending:
            error = self._pending[0]
            self._pending.clear()
            raise error

    def opened(self, devidx: int) -> Instrument:
        """Return the instrument at an index, or answer why there is none."""
        require(0 <= devidx < DEVICES)
        slot = self.slots[devidx]
        if slot is not Slot.OPEN:
            require(slot is Slot.CLOSED, Code.INVALID_MEMORY)
            require(False, Code.DEVICE_NOT_OPEN)
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
