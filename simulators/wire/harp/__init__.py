"""A simulated HydraHarp 400: the 44 functions of HHLib 3.0 as C callbacks, driven by the bench.

    simulator = HydraHarpSimulator(bench)
    library = HHLib(simulator.functions)        # or any other program that takes the 44 functions
    ...
    simulator.raise_pending()

One instrument is connected, at index 0, or several from there on. Which codes are returned without an open
instrument, and which arguments are checked before the instrument's state, follows the vendor's library as
observed without hardware. Its behaviour with an open instrument could not be observed; where the
documentation leaves it open, the stricter choice is made and called unconfirmed where it stands.

Not simulated
-------------
- T2 and continuous mode deliver no data: `HH_ReadFiFo` and `HH_GetContModeBlock` answer with nothing.
- Control inputs: no pulse ever comes at C1, and a measurement that waits for one never begins.
- In T3 mode, dead times do not reach from one `tagging.PIECE_S` to the next.
- Zero crossings of the discriminators, and jitter of the instrument: the bench's photons already have the
  time resolution of the whole system. Dead time, differential non-linearity and drift are in `timing`, off
  unless asked for; the heights of the pulses that the discriminators see are in `discriminators`.
- The additional jitter that a sync divider is said to bring.
- The time that commands and readout take on USB: no bench time passes in them.
- A sync that goes and returns within one histogram: only its begin and end are looked at.
- Fluctuation of the rates: they are the expected ones.
- A stop on overflow shows at the end of the acquisition time, not before; elapsed time and counts are those
  of the stop.
"""

from simulators.wire.harp.discriminators import Pulses
from simulators.wire.harp.fifo import Fifo
from simulators.wire.harp.simulator import HydraHarpSimulator
from simulators.wire.harp.timing import Nonlinearity, Timing

__all__ = ["Fifo", "HydraHarpSimulator", "Nonlinearity", "Pulses", "Timing"]
