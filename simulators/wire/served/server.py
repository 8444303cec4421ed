"""The loop that serves one bench to other programs."""

import selectors
import socket
import tempfile
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

from simulators.bench import Bench
from simulators.wire.daq import DaqWiring, SimulatedBoard
from simulators.wire.galvo import GalvoBoard
from simulators.wire.laser import KatanaHead
from simulators.wire.laser_head import LaserHead
from simulators.wire.lines import LineFirmware
from simulators.wire.served.board import BoardAnswers
from simulators.wire.served.detector import DetectorLine
from simulators.wire.served.system import local_socket
from simulators.wire.served.terminal import Terminal
from simulators.wire.served.timing import LONGEST, TimingAnswers, TimingFaults
from simulators.wire.spad import DetectorInstrument, SpadInstrument
from simulators.wire.tmc import TmcInterface

#: Bytes that are taken from a socket at a time.
PIECE = 65536


@dataclass(frozen=True)
class Addresses:
    """Where other programs find the devices.

    Attributes
    ----------
    galvo, laser, detector, delayer
        Pseudo-terminals; None where there is no such device, or it has no data interface.
    timing
        Path of the socket for timing instruments, and for the DAQ board.
    """

    galvo: str
    laser: str | None
    detector: str | None
    timing: str
    delayer: str | None = None


class BenchServer:
    """Serves a bench while entered; POSIX only.

    One loop does everything to the bench in turn, so that it needs no locks, and sleeps while nobody asks.
    Only photons are drawn in a thread beside it, so that the laser answers also while many are drawn. A
    program that goes away changes nothing on the bench, and the next can connect.

    Parameters
    ----------
    bench
        What is served; its clock should run in real time.
    faults
        How timing instruments on it count.
    wiring
        What hangs on its DAQ board.
    laser, detector, delayer
        Make these devices; None where there is no such one, or it has no data interface.

    Attributes
    ----------
    addresses
        Where the devices are.
    """

    def __init__(
        self,
        bench: Bench,
        faults: TimingFaults,
        wiring: DaqWiring | None = None,
        *,
        laser: Callable[[Bench], LaserHead] | None = KatanaHead,
        detector: Callable[[Bench], DetectorInstrument] | None = SpadInstrument,
        delayer: Callable[[Bench], LineFirmware] | None = None,
    ) -> None:
        self._bench = bench
        self._faults = faults
        self._board = SimulatedBoard(bench, wiring)
        self._selector = selectors.DefaultSelector()
        self._connections: set[_Connection] = set()
        self._head = laser(bench) if laser else None
        self._detector = detector(bench) if detector else None
        self._delayer = delayer(bench) if delayer else None
        self._interlock_closed = True
        self._running = True

    def __enter__(self) -> Self:
        self._wake, self._woken = socket.socketpair()
        self._woken.setblocking(False)
        self._watch(self._woken, self._look_round)
        self._drawer = ThreadPoolExecutor(max_workers=1)
        self._terminals: list[Terminal] = []
        galvo = self._terminal(GalvoBoard(self._bench))
        laser = self._terminal(self._head) if self._head else None
        head = self._detector
        if isinstance(head, SpadInstrument):
            head = DetectorLine(TmcInterface(head))
        detector = self._terminal(head) if head else None
        delayer = self._terminal(self._delayer) if self._delayer else None
        # a folder of its own, which nobody else on the computer may enter
        self._folder = tempfile.TemporaryDirectory(prefix="rig-sim-")
        self._listener = local_socket()
        path = str(Path(self._folder.name) / "timing")
        self._listener.bind(path)
        self._listener.listen()
        self._listener.setblocking(False)
        self._watch(self._listener, self._accept)
        self.addresses = Addresses(galvo, laser, detector, path, delayer)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._drawer.shutdown(cancel_futures=True)
        for connection in self._connections:
            connection.socket.close()
        self._selector.close()
        for terminal in self._terminals:
            terminal.close()
        for one in (self._listener, self._wake, self._woken):
            one.close()
        self._folder.cleanup()

    def now_s(self) -> float:
        """Return the bench time, which is that of the log."""
        return self._bench.clock.now_s()

    def run(self) -> None:
        """Serve until `stop` is called."""
        while self._running:
            for key, _ in self._selector.select():
                key.data()
            if not self._connections:  # nobody can ask about the past
                self._bench.forget_before(self._bench.clock.now_s())

    def stop(self) -> None:
        """End `run`; may be called from another thread or from a signal handler."""
        self._running = False
        self._wake.send(b"\0")

    def switch_interlock(self) -> None:
        """Open the laser's interlock, or close it again; may be called where `stop` may."""
        self._interlock_closed = not self._interlock_closed
        self._wake.send(b"\0")

    def _terminal(self, firmware: LineFirmware) -> str:
        """Serve a device at a pseudo-terminal of its own, and return its address."""
        terminal = Terminal(firmware)
        self._terminals.append(terminal)
        self._watch(terminal, terminal.serve)
        return terminal.address

    def _watch(self, what: "socket.socket | Terminal", serve: Callable[[], None]) -> None:
        self._selector.register(what, selectors.EVENT_READ, serve)

    def _look_round(self) -> None:
        """Go on where an answer has been made."""
        self._woken.recv(PIECE)
        if self._head:
            self._head.close_interlock(self._interlock_closed)
        for connection in list(self._connections):
            self._serve(connection)

    def _accept(self) -> None:
        with suppress(OSError):  # it may have gone again already
            board = BoardAnswers(self._board)
            answers = TimingAnswers(self._bench, self._faults, {"board": board.tell})
            connection = _Connection(self._listener.accept()[0], partial(self._take, answers), board.leave)
            self._connections.add(connection)
            self._serve(connection)

    def _take(self, answers: TimingAnswers, line: bytes) -> "Future[bytes]":
        made = self._drawer.submit(answers.take(line))
        made.add_done_callback(lambda _: self._wake.send(b"\0"))
        return made

    def _serve(self, connection: "_Connection") -> None:
        with suppress(KeyError, ValueError):  # it may have been left out while an answer was made, or is gone
            self._selector.unregister(connection.socket)
        try:
            connection.serve()
        except OSError:
            self._connections.discard(connection)
            connection.socket.close()
            connection.leave()
            return
        if connection.events:
            self._selector.register(connection.socket, connection.events, partial(self._serve, connection))


class _Connection:
    """One timing instrument or DAQ board in another program; the server never waits for it.

    Parameters
    ----------
    accepted
        Its socket.
    take
        Takes a request and returns what makes the answer, which the workers do.
    leave
        Called when the program is gone.
    """

    def __init__(
        self,
        accepted: socket.socket,
        take: "Callable[[bytes], Future[bytes]]",
        leave: Callable[[], None],
    ) -> None:
        accepted.setblocking(False)
        self.socket = accepted
        self.leave = leave
        self._take = take
        self._received = bytearray()
        self._answer: Future[bytes] | None = None
        self._unsent = memoryview(b"")

    @property
    def events(self) -> int:
        """What is waited for at the socket; 0 while an answer is being made."""
        if self._unsent:
            return selectors.EVENT_WRITE
        return 0 if self._answer else selectors.EVENT_READ

    def serve(self) -> None:
        """Go as far as possible: take what has come, answer it, and send what can be sent.

        Raises
        ------
        OSError
            If the program is gone, or sends what can be no request.
        """
        with suppress(BlockingIOError):
            while True:
                if self._unsent:
                    self._unsent = self._unsent[self.socket.send(self._unsent) :]
                elif self._answer is None:
                    self._listen()
                elif self._answer.done():
                    self._unsent, self._answer = memoryview(self._answer.result()), None
                else:
                    return

    def _listen(self) -> None:
        line, newline, rest = self._received.partition(b"\n")
        if newline:
            self._received = rest
            self._answer = self._take(bytes(line))
            return
        piece = self.socket.recv(PIECE)
        if not piece or len(self._received) > LONGEST:
            raise ConnectionAbortedError
        self._received += piece
