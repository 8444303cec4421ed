"""The instrument's memory for records, and the USB link that empties it. No C."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

#: Records come in blocks of so many while there are as many (USB 3; manual).
BLOCK = 128


class Fifo:
    """Records that wait to be read.

    Parameters
    ----------
    capacity
        How many records it holds (2 097 152 in the instrument: what a public device server says).
    link_hz
        Records a second that the link takes (manual: USB 3 40 million, USB 2 9 million).

    Attributes
    ----------
    full
        Whether records were lost because it was full. From then on it takes none (unconfirmed): what is read
        is what happened until then, without a gap.
    """

    def __init__(self, capacity: int = 1 << 21, link_hz: float = 40e6) -> None:
        self.capacity = capacity
        self.link_hz = link_hz
        self.start(0.0)

    def start(self, now_s: float) -> None:
        """Begin anew, empty."""
        self.full = False
        self._link_took = 0.0  # records that the link has had time for
        self._asked_s = now_s
        self.drop()

    def drop(self) -> None:
        """Throw all records away."""
        self._chunks: deque[NDArray[np.uint32]] = deque()
        self._held = 0

    def put(self, words: NDArray[np.uint32]) -> None:
        """Take records, as many as there is room for."""
        if self.full or not len(words):
            return
        room = self.capacity - self._held
        self.full = len(words) > room
        self._chunks.append(words[:room])
        self._held += len(self._chunks[-1])

    def take(self, count: int, now_s: float) -> NDArray[np.uint32]:
        """Return up to ``count`` records, as many as the link has had time for since it was asked last."""
        self._link_took = min(self._link_took + self.link_hz * (now_s - self._asked_s), self.capacity)
        self._asked_s = now_s
        number = min(count, self._held, int(self._link_took))
        if self._held >= BLOCK:
            number -= number % BLOCK
        self._link_took -= number
        self._held -= number
        taken = [np.empty(0, np.uint32)]
        while number > 0:
            chunk = self._chunks.popleft()
            if len(chunk) > number:
                self._chunks.appendleft(chunk[number:])
            taken.append(chunk[:number])
            number -= len(taken[-1])
        return np.concatenate(taken)
