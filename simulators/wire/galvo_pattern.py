"""The pattern unit of one axis: samples of the memory, one at each edge of the trigger.

Unconfirmed, and so a choice made here: the output is the first sample as soon as the unit runs, the first
edge brings that sample, and each further edge the next; the end is the last sample; after the last cycle the
output stays there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass
class PatternUnit:
    """Registers of the unit, with the firmware's defaults.

    Attributes
    ----------
    unit
        What samples are: 2 is X or Y.
    run
        Whether it goes on with each edge.
    start, end
        First and last sample in memory.
    speed_hz
        Samples a second without a trigger.
    cycles
        How often the samples are gone through; below 0 without end.
    trigger
        0 none, 1 both edges, 2 the rising edge.
    edges
        How many edges have come since it runs.
    """

    unit: int = 2
    run: int = 0
    start: int = 0
    end: int = 0
    speed_hz: float = 10_000.0
    cycles: int = -1
    trigger: int = 0
    edges: int = 0

    @property
    def edges_a_pulse(self) -> int:
        """How many edges count of each pulse at the trigger input."""
        return {1: 2, 2: 1}.get(self.trigger, 0) if self.run else 0

    @property
    def index(self) -> int:
        """Place in memory of the present sample."""
        return int(self.places(np.zeros(1, np.int64))[0])

    def places(self, further: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the places in memory (n,) after so many further edges (n,)."""
        gone = np.maximum(self.edges + further - 1, 0)
        length = max(self.end - self.start + 1, 1)
        if self.cycles >= 0:
            gone = np.minimum(gone, max(self.cycles, 1) * length - 1)
        return self.start + gone % length
