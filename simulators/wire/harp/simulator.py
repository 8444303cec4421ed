"""The simulated library: one instrument, and the 44 C functions that reach it."""

from collections.abc import Sequence
from types import SimpleNamespace

from simulators.wire.harp import information, measuring, setting
from simulators.wire.harp.connection import Connection
from simulators.wire.harp.discriminators import MeasuredBench
from simulators.wire.harp.exports import Exports, as_c_functions
from simulators.wire.harp.fifo import Fifo
from simulators.wire.harp.instrument import Instrument
from simulators.wire.harp.timing import Timing


class HydraHarpSimulator:
    """HHLib 3.0 with one HydraHarp connected, at index 0, or with several.

    Parameters
    ----------
    bench
        The optical bench that it measures; each detector channel is connected to its input.
    serial
        Serial number, at most 7 characters.
    others
        Serial numbers of further instruments, at the indices from 1 on; all of them measure the same bench.
    inputs
        Number of inputs; by default 2, or as many as the detector needs. A real HydraHarp has 8 at most
        (MAXINPCHAN of its header); the simulated one takes more, so that a detector of many pixels fits.
    count_depth
        Largest count of a bin: 2**32 - 1 in the instrument. 65535 gives the saturation of 16-bit data.
    timing
        Faults of its clock; by default none.
    fifo
        Its memory for records and the link that empties it; by default those of a HydraHarp at USB 3.
    sync_period_unit_s
        Unit of `HH_GetSyncPeriod`: 1.0 as the vendor's C demo takes it, or 1e-12 as the manual says. Which of
        the two a real instrument gives is unconfirmed.

    Attributes
    ----------
    functions
        An object with the 44 C functions as attributes.
    instrument, connection
        The instrument, and whether it is there and open.
    """

    def __init__(
        self,
        bench: MeasuredBench,
        *,
        serial: str = "1000001",
        others: Sequence[str] = (),
        inputs: int | None = None,
        count_depth: int = 2**32 - 1,
        timing: Timing | None = None,
        fifo: Fifo | None = None,
        sync_period_unit_s: float = 1.0,
    ) -> None:
        for one in (serial, *others):
            if len(one) > 7:
                raise ValueError(f"serial {one!r} is longer than 7 characters")
        needed = 1 + max((channel.input for channel in bench.channels), default=0)
        inputs = max(needed, 2) if inputs is None else inputs
        if inputs < needed:
            raise ValueError(f"the detector is connected to input {needed - 1}, but there are only {inputs}")
        self.instrument = Instrument(bench, inputs, count_depth, timing or Timing(), fifo or Fifo())
        instruments = {one: Instrument(bench, inputs, count_depth, Timing(), Fifo()) for one in others}
        self.connection = Connection({serial: self.instrument, **instruments}, sync_period_unit_s)
        self._pending: list[BaseException] = []
        exports = Exports([*information.EXPORTS, *setting.EXPORTS, *measuring.EXPORTS])
        self.functions: SimpleNamespace = as_c_functions(exports, self.connection, self._pending.append)

    def raise_pending(self) -> None:
        """Raise the first exception that a function has swallowed since the last call of this method."""
        if self._pending:
            error = self._pending[0]
            self._pending.clear()
            raise error
