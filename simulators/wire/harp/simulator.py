"""The simulated library: instruments, and the C functions that reach them."""

from collections.abc import Sequence
from functools import partial
from types import SimpleNamespace

from simulators.wire.harp import information, measuring, setting
from simulators.wire.harp.connection import Connection
from simulators.wire.harp.discriminators import MeasuredBench
from simulators.wire.harp.exports import Exports, as_c_functions
from simulators.wire.harp.families import HYDRAHARP, SimulatedFamily
from simulators.wire.harp.fifo import Fifo
from simulators.wire.harp.instrument import Instrument
from simulators.wire.harp.timing import Timing


class HarpSimulator:
    """A vendor's library with one instrument connected, at index 0, or with several.

    Parameters
    ----------
    bench
        The optical bench that it measures; each detector channel is connected to its input.
    family
        What library and instrument it is.
    serial
        Serial number, at most 7 characters.
    others
        Serial numbers of further instruments, at the indices from 1 on; all of them measure the same bench.
    inputs
        Number of inputs; by default 2, or as many as the detector needs. A real HydraHarp 400 has 8 at most,
        a TimeHarp 260 has 2; the simulated ones take more, so that a detector of many pixels fits.
    count_depth
        Largest count of a bin: 2**32 - 1 in the instrument. 65535 gives the saturation of 16-bit data.
    timing
        Faults of its clock; by default none.
    fifo
        Its memory for records and the link that empties it; by default those of a HydraHarp 400 at USB 3.

    Attributes
    ----------
    functions
        An object with the C functions as attributes.
    instrument, connection
        The instrument, and whether it is there and open.
    """

    def __init__(
        self,
        bench: MeasuredBench,
        family: SimulatedFamily = HYDRAHARP,
        *,
        serial: str = "1000001",
        others: Sequence[str] = (),
        inputs: int | None = None,
        count_depth: int = 2**32 - 1,
        timing: Timing | None = None,
        fifo: Fifo | None = None,
    ) -> None:
        for one in (serial, *others):
            if len(one) > 7:
                raise ValueError(f"serial {one!r} is longer than 7 characters")
        needed = 1 + max((channel.input for channel in bench.channels), default=0)
        inputs = max(needed, 2) if inputs is None else inputs
        if inputs < needed:
            raise ValueError(f"the detector is connected to input {needed - 1}, but there are only {inputs}")
        make = partial(Instrument, family, bench, inputs, count_depth=count_depth)
        self.instrument = make(timing=timing or Timing(), fifo=fifo or Fifo())
        self.instrument.warm_up()
        instruments = {one: make(timing=Timing(), fifo=Fifo()) for one in others}
        self.connection = Connection(family, {serial: self.instrument, **instruments})
        self._pending: list[BaseException] = []
        exports = Exports([*information.EXPORTS, *setting.EXPORTS, *measuring.EXPORTS])
        self.functions: SimpleNamespace = as_c_functions(
            exports, family, self.connection, self._pending.append
        )

    def raise_pending(self) -> None:
        """Raise the first exception that a function has swallowed since the last call of this method."""
        if self._pending:
            error = self._pending[0]
            self._pending.clear()
            raise error
