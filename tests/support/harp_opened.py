"""The simulated library, opened, by its C functions."""

import numpy as np

from simulators.wire.harp import HarpSimulator
from support.harp_wire import call

HISTOGRAM, T2, T3, CONTINUOUS = 0, 2, 3, 8


class Opened:
    """The functions at index 0, opened and initialised; calls must succeed, but for `code`."""

    def __init__(self, bench, *, mode=HISTOGRAM, **instrument):
        self.bench = bench
        self.simulator = HarpSimulator(bench, **instrument)
        self("HH_OpenDevice")
        self("HH_Initialize", mode, 0)
        self("HH_Calibrate")

    def __call__(self, name, *arguments):
        code, *outputs = call(self.simulator.functions, name, 0, *arguments)
        self.simulator.raise_pending()
        assert code == 0, f"{name} returned {code}"
        return outputs[0] if len(outputs) == 1 else outputs

    def code(self, name, *arguments):
        return call(self.simulator.functions, name, 0, *arguments)[0]

    def run(self, tacq_ms, *, for_s=None):
        self("HH_StartMeas", tacq_ms)
        self.bench.clock.sleep(tacq_ms / 1000 if for_s is None else for_s)
        ended = self("HH_CTCStatus")
        self("HH_StopMeas")
        return ended

    def counts(self, channel=0, length=65536, clear=0):
        return np.array(self("HH_GetHistogram", channel, clear)[:length])
