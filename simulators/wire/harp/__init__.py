"""Simulated timing instruments of PicoQuant: the functions of their libraries as C callbacks, on the bench.

    simulator = HarpSimulator(bench, MULTIHARP)
    simulator.functions.MH_OpenDevice(0, serial)        # or any program that takes these functions
    ...
    simulator.raise_pending()

One instrument is connected, at index 0, or several from there on. Which codes are returned without an open
instrument, and which arguments are checked before the instrument's state, follows the vendor's library as
observed without hardware. Its behaviour with an open instrument could not be observed; where the
documentation leaves it open, the stricter choice is made and called unconfirmed where it stands.

Not simulated
-------------
- T2 and continuous mode deliver no data: ReadFiFo and GetContModeBlock answer with nothing.
- Of the families' functions those for event filters, White Rabbit, an external FPGA, dead times, hysteresis,
  the trigger output and other than the usual timing mode are missing.
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
from simulators.wire.harp.families import FAMILIES, SimulatedFamily
from simulators.wire.harp.fifo import Fifo
from simulators.wire.harp.simulator import HarpSimulator
from simulators.wire.harp.timing import Nonlinearity, Timing

__all__ = ["FAMILIES", "Fifo", "HarpSimulator", "Nonlinearity", "Pulses", "SimulatedFamily", "Timing"]
