"""Events of time-tagged mode (T3) and the 32-bit records that tell them. Plain numpy, no C.

A record has, from its highest bit: special (1), channel (6), bin after the sync edge (15), number of that
edge modulo 1024 (10). Special records are overflows of the edge's number (channel 63; the lowest bits say how
many) and markers (channel 1 to 15, a bit for each input). Source: PicoQuant's public notes on its T3 formats.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

#: Bins after a sync edge that a record can tell.
DTIME_BINS = 1 << 15
#: The inputs that a record can tell; channel 63 is the overflows'.
MOST_INPUTS = 63

_EDGES = 1 << 10
_MOST_OVERFLOWS = _EDGES - 1
_OVERFLOW = np.uint32(0x7F << 25)
_SPECIAL = 1 << 6
_CODE_BITS = 15 + 7


@dataclass(frozen=True)
class Events:
    """Photons and markers.

    Attributes
    ----------
    edge
        (n,) int64, number of the last sync edge before each, counted from the start of the measurement.
    code
        (n,) int64, the bin after that edge in the bits from 7 up, special and channel below. A marker has a
        bin too, so that it finds its place among the photons; its record has none.
    """

    edge: NDArray[np.int64]
    code: NDArray[np.int64]

    @classmethod
    def photons(cls, edge: NDArray[np.int64], dtime: NDArray[np.int64], at_input: int) -> Self:
        """Return photons of one input."""
        return cls(edge, (dtime << 7) | at_input)

    @classmethod
    def markers(cls, edge: Iterable[int], dtime: Iterable[int], masks: Iterable[int]) -> Self:
        """Return markers, a mask of several bits where several came together."""
        code = [(bin_ << 7) | _SPECIAL | mask for bin_, mask in zip(dtime, masks, strict=True)]
        return cls(np.array(list(edge), np.int64), np.array(code, np.int64))

    @classmethod
    def together(cls, parts: Iterable["Events"]) -> Self:
        """Return the events of several sources in order of time."""
        parts = list(parts)
        edge = np.concatenate([part.edge for part in parts])
        code = np.concatenate([part.code for part in parts])
        if not len(edge):
            return cls(edge, code)
        first = edge.min()
        key = ((edge - first) << _CODE_BITS) | code
        key.sort(kind="stable")  # parts are nearly sorted, and this sort is quick with such
        return cls((key >> _CODE_BITS) + first, key & ((1 << _CODE_BITS) - 1))

    def __len__(self) -> int:
        return len(self.edge)

    def __getitem__(self, some: slice) -> "Events":
        return Events(self.edge[some], self.code[some])


def no_events() -> Events:
    """Return no events."""
    return Events(np.empty(0, np.int64), np.empty(0, np.int64))


def encoded(events: Events, from_edge: int, to_edge: int) -> NDArray[np.uint32]:
    """Return the records of events in order, with overflows wherever the edge's number passes a 1024th.

    Where nothing happens for long, one record tells many overflows; the last ones stand at the end, so that
    who reads learns that time goes on. (When the instrument tells them without a photon is unconfirmed.)

    Parameters
    ----------
    events
        Photons and markers.
    from_edge, to_edge
        The edges up to which was told before, and shall be told now.
    """
    low, dtime = events.code & 0x7F, events.code >> 7
    dtime[low >= _SPECIAL] = 0
    wraps = np.diff(np.concatenate([[from_edge], events.edge, [to_edge]]) // _EDGES)
    added = -(-wraps // _MOST_OVERFLOWS)  # overflow records before each event, and after the last
    place = np.arange(len(events)) + np.cumsum(added[:-1])
    words = np.full(len(events) + int(added.sum()), _OVERFLOW | np.uint32(_MOST_OVERFLOWS), np.uint32)
    words[place] = (low << 25) | (dtime << 10) | (events.edge % _EDGES)
    late = added > 0
    ends = np.append(place, len(words))[late] - 1  # the last of the overflow records in a row
    words[ends] = _OVERFLOW | (wraps - _MOST_OVERFLOWS * (added - 1))[late].astype(np.uint32)
    return words
