"""The thread that empties the instrument's memory of records while it measures.

The order of calls follows the manual and the vendor's demos: records, flags, and while there are none the end
of the acquisition time; after that, reads until several in a row brought nothing; then StopMeas.
"""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from concurrent.futures import TimeoutError as NotYet
from dataclasses import dataclass
from queue import Empty, Queue
from threading import Event, Thread
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.errors import DeviceError, LinkError, ProtocolError
from drivers.harp.errors import HarpError
from drivers.harp.instrument import CLOCK_ERROR, LATE_S, system_error
from drivers.harp.library import HarpLibrary

#: How long to wait when all there is was read, and after the end of the acquisition time [s].
POLL_S = 10e-3
DRAIN_S = 1e-3

#: So many reads in a row must bring nothing after the end (vendor's demos: more than five).
EMPTY_READS = 6

#: So many reads may come after the time by which it must have ended: twice what a full memory takes.
LAST_READS = 32

#: How long a memory that was full is read [s]; USB 2 takes a quarter of it for 2 million records.
REST_S = 1.0

#: Pieces that may wait for the caller: with a piece each `POLL_S`, those of 2.5 s.
QUEUE_PIECES = 256

#: Records that may wait with them, unless they are one piece: at 40 million a second those of 0.8 s, 128 MiB.
QUEUE_RECORDS = 1 << 25

#: A caller that wants to be asked when nothing comes is asked so often [s].
IDLE_S = 0.05

#: How long to wait for room in that queue [s]; meanwhile records wait in the instrument.
PATIENCE_S = 1.0

#: When the thread has given no sign for so long [s], a call of the library does not return.
SILENT_S = 10.0


@dataclass(frozen=True)
class Fault:
    """Something that went wrong while the instrument recorded.

    Attributes
    ----------
    flag
        The flag that the instrument raised.
    record
        Number of records that had been read when it was seen. It happened since the piece before was read, so
        that piece, this one or the next has the frame that it spoils.
    sentence
        What it means, for a person.
    """

    flag: int
    record: int
    sentence: str


@dataclass(frozen=True)
class Piece:
    """Records in the order of time, as many as one read brought.

    Attributes
    ----------
    records
        (n,) uint32, see `drivers.harp.records`; may be empty where there are faults.
    first
        Number of the first of them in the measurement.
    flags
        What the instrument showed right after the read (`Flags`), without that it measures.
    faults
        What it had not shown the time before. A system error is told by the exception that follows it.
    """

    records: NDArray[np.uint32]
    first: int
    flags: int
    faults: tuple[Fault, ...]


class Reader:
    """Reads a measurement that was started to its end, and stops it.

    Parameters
    ----------
    library, index, name
        The instrument.
    clock
        The time to wait by.
    began_s
        When the measurement began, at the earliest.
    duration_s
        How long after that it ends by itself.
    queue_pieces
        How many pieces may wait for the caller.
    """

    def __init__(
        self,
        library: HarpLibrary,
        index: int,
        *,
        name: str,
        clock: Clock,
        began_s: float,
        duration_s: float,
        queue_pieces: int,
    ) -> None:
        self._library, self._index, self._name, self._clock = library, index, name, clock
        self._began_s, self._duration_s = began_s, duration_s
        self._queue_pieces = queue_pieces
        self._pieces: Queue[Piece | None] = Queue()  # this thread alone fills it, and looks how full it is
        self._asked: Queue[tuple[Callable[[], Any], Future[Any]]] = Queue()
        self._bits = library.family.flags
        self._fatal_bits = self._bits.fifo_full | self._bits.errors
        self._buffer = library.fifo_buffer()
        self._records = np.ctypeslib.as_array(self._buffer)
        self._read = self._taken = 0
        self._flags = 0
        self._ending = Event()
        self._problem: BaseException | None = None
        self._sign_s = time.monotonic()
        self._thread = Thread(target=self._run, name=f"records of {name}", daemon=True)
        self._thread.start()

    @property
    def runs(self) -> bool:
        """Whether the measurement is not over."""
        return self._thread.is_alive()

    def end(self) -> None:
        """Stop the measurement as soon as what is there was read.

        Raises
        ------
        LinkError
            If the library does not answer.
        """
        self._ending.set()
        if not self.ended():
            raise self._silence()

    def ended(self) -> bool:
        """Wait for the thread to end; return False if it does not."""
        self._thread.join(SILENT_S)
        return not self._thread.is_alive()

    def ask(self, call: Callable[[], Any]) -> Any:
        """Return what a call of the library returns; while the measurement runs, the thread makes it.

        Raises
        ------
        LinkError
            If the library does not answer.
        """
        answer: Future[Any] = Future()
        self._asked.put((call, answer))
        while self._thread.is_alive():
            try:
                return answer.result(timeout=IDLE_S)
            except NotYet:
                self._require_sign()
        if not answer.done():  # the thread ended before it came to that
            return call()
        return answer.result()

    def pieces(self, *, idle: bool = False) -> Iterator[Piece]:
        """Yield the pieces as they come, then raise what went wrong; see `HarpStream.pieces`.

        Parameters
        ----------
        idle
            Yield an empty piece when none has come for `IDLE_S`.
        """
        nothing = Piece(np.empty(0, np.uint32), self._read, 0, ())
        while True:
            try:
                piece = self._pieces.get(timeout=IDLE_S)
            except Empty:
                if not self._thread.is_alive() and self._pieces.empty():
                    break
                self._require_sign()
                if idle:
                    yield nothing
                continue
            if piece is None:
                break
            self._taken += len(piece.records)
            yield piece
        if self._problem is not None:
            raise self._problem

    def _require_sign(self) -> None:
        if time.monotonic() - self._sign_s > SILENT_S:
            raise self._silence()

    def _silence(self) -> LinkError:
        return LinkError(
            self._name,
            "read its records",
            f"a call of {self._library.name} did not return",
            f"End this program. {self._restart}",
        )

    @property
    def _restart(self) -> str:
        link = self._library.family.link
        return f"{link.check}, and {link.restart}."

    # In the thread

    def _run(self) -> None:
        try:
            self._read_to_the_end()
        except BaseException as problem:  # for the caller, who takes what was read before
            self._problem = problem
        try:
            self._library.stop_meas(self._index)
        except HarpError as problem:
            self._problem = self._problem or problem
        self._pieces.put(None)

    def _read_to_the_end(self) -> None:
        until_s = self._clock.now_s() + self._duration_s * (1 + CLOCK_ERROR) + LATE_S
        empty = overdue = 0
        while empty < EMPTY_READS:
            number = self._read_once()
            if self._flags & self._fatal_bits:
                self._read_rest()
                raise self._fatal()
            overdue += self._clock.now_s() > until_s
            if overdue > LAST_READS:
                raise self._late()
            if number == len(self._buffer):
                continue
            if self._ending.is_set():
                return
            ended = self._library.ctc_ended(self._index)
            empty = empty + 1 if ended and not number else 0
            self._clock.sleep(DRAIN_S if ended else POLL_S)
        self._require_lasted()

    def _require_lasted(self) -> None:
        """Raise if it is over earlier than it can be: it did not start, although there was no error."""
        lasted_s = self._clock.now_s() - self._began_s
        if lasted_s < (1 - CLOCK_ERROR) * self._duration_s:
            raise ProtocolError(
                self._name,
                f"measure for {self._duration_s:g} s",
                f"it was over after {lasted_s:.3g} s, and no error was reported",
                self._restart,
            )

    def _read_rest(self) -> None:
        """Read what is left in a memory that was full."""
        until_s = self._clock.now_s() + REST_S
        empty = 0
        while empty < EMPTY_READS and self._clock.now_s() < until_s:
            self._clock.sleep(DRAIN_S)
            empty = 0 if self._read_once() else empty + 1

    def _read_once(self) -> int:
        """Read, look at the flags, and hand over; return the number of records."""
        self._sign_s = time.monotonic()
        self._answer()
        number = self._library.read_fifo(self._index, self._buffer)
        first, self._read = self._read, self._read + number
        before, now = self._flags, self._library.get_flags(self._index)
        self._flags = now & ~self._bits.active
        told = self._bits.told(self._flags & ~before)
        faults = tuple(Fault(flag, self._read, text) for flag, text in told)
        if number or faults:
            self._wait_for_room()
            self._pieces.put(Piece(self._records[:number].copy(), first, self._flags, faults))
        return number

    def _answer(self) -> None:
        """Make the calls that others asked for."""
        while not self._asked.empty():
            call, answer = self._asked.get()
            try:
                answer.set_result(call())
            except BaseException as problem:  # for who asked
                answer.set_exception(problem)

    def _wait_for_room(self) -> None:
        # by the clock of the devices: where it stands still meanwhile, nothing is lost by waiting
        until_s = self._clock.now_s() + PATIENCE_S
        while self._is_full() and not self._ending.wait(1e-3):
            self._sign_s = time.monotonic()
            self._answer()
            if self._clock.now_s() > until_s:
                raise DeviceError(
                    self._name,
                    "pass on its records",
                    f"{self._pieces.qsize()} pieces of records wait to be processed, "
                    f"and none was processed for {PATIENCE_S:g} s",
                    "Attenuate, or let the program do less with each photon.",
                )

    def _is_full(self) -> bool:
        """Whether as much waits as may; what the caller takes meanwhile only makes room."""
        waiting = self._pieces.qsize()
        return waiting >= self._queue_pieces or (waiting > 0 and self._read - self._taken > QUEUE_RECORDS)

    def _fatal(self) -> DeviceError:
        if self._flags & self._bits.errors:
            return system_error(self._library, self._index, self._name)
        return DeviceError(
            self._name,
            "record each photon",
            f"its memory was full after {self._read} records, so that later ones are lost",
            "Attenuate, or run less on this computer at the same time.",
        )

    def _late(self) -> LinkError:
        return LinkError(
            self._name,
            f"measure for {self._duration_s:g} s",
            f"it still runs {LATE_S:g} s after its planned end, and after {LAST_READS} more reads",
            self._restart,
        )
