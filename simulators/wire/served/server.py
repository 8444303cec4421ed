"""The loop that serves one bench to other programs."""

import selectors
import socket
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

from simulators.bench import Bench
from simulators.wire.galvo import GalvoBoard
from simulators.wire.laser import KatanaHead
from simulators.wire.served.detector import DetectorLine
from simulators.wire.served.terminal import Terminal
from simulators.wire.served.timing import LONGEST, TimingAnswers, TimingFaults
from simulators.wire.spad import SpadInstrument
from simulators.wire.tmc import TmcInterface

#: Bytes that are taken from a socket at a time.
PIECE = 65536


@dataclass(frozen=True)
class Addresses:
    """Where other programs find the devices.

    Attributes
    ----------
    galvo, laser, detector
        Pseudo-terminals.
    timing
        Path of the socket for timing instruments.
    """

    galvo: str
    laser: str
    detector: str
    timing: str


class BenchServer:
    """Serves a bench while entered; POSIX only.

    One loop does everything in turn, so that the bench needs no locks; it sleeps while nobody asks. A program
    that goes away changes nothing on the bench, and the next can connect.

    Parameters
    ----------
    bench
        What is served; its clock should run in real time.
    faults
        How timing instruments on it count.

    Attributes
    ----------
    addresses
        Where the devices are.
    """

    def __init__(self, bench: Bench, faults: TimingFaults) -> None:
        self._bench = bench
        self._answers = TimingAnswers(bench, faults)
        self._selector = selectors.DefaultSelector()
        self._connections: set[_Connection] = set()
        self._running = True

    def __enter__(self) -> Self:
        self._wake, self._woken = socket.socketpair()
        self._woken.setblocking(False)
        self._watch(self._woken, self._end)
        galvo, laser, detector = (
            Terminal(firmware)
            for firmware in (
                GalvoBoard(self._bench),
                KatanaHead(self._bench),
                DetectorLine(TmcInterface(SpadInstrument(self._bench))),
            )
        )
        self._terminals = (galvo, laser, detector)
        for terminal in self._terminals:
            self._watch(terminal, terminal.serve)
        # a folder of its own, which nobody else on the computer may enter
        self._folder = tempfile.TemporaryDirectory(prefix="rig-sim-")
        self._listener = socket.socket(socket.AF_UNIX)
        path = str(Path(self._folder.name) / "timing")
        self._listener.bind(path)
        self._listener.listen()
        self._listener.setblocking(False)
        self._watch(self._listener, self._accept)
        self.addresses = Addresses(galvo.address, laser.address, detector.address, path)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for connection in list(self._connections):
            self._drop(connection)
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
        self._wake.send(b"\0")

    def _watch(self, what: "socket.socket | Terminal", serve: Callable[[], None]) -> None:
        self._selector.register(what, selectors.EVENT_READ, serve)

    def _end(self) -> None:
        self._running = False

    def _accept(self) -> None:
        with suppress(OSError):  # it may have gone again already
            connection = _Connection(self._listener.accept()[0], self._answers)
            self._connections.add(connection)
            self._watch(connection.socket, partial(self._serve, connection))

    def _serve(self, connection: "_Connection") -> None:
        try:
            connection.serve()
        except OSError:
            self._drop(connection)
            return
        events = selectors.EVENT_WRITE if connection.unsent else selectors.EVENT_READ
        self._selector.modify(connection.socket, events, partial(self._serve, connection))

    def _drop(self, connection: "_Connection") -> None:
        self._connections.discard(connection)
        self._selector.unregister(connection.socket)
        connection.socket.close()


class _Connection:
    """One timing instrument in another program; the server never waits for it.

    Attributes
    ----------
    unsent
        What it has yet to take; until then it is not listened to.
    """

    def __init__(self, accepted: socket.socket, answers: TimingAnswers) -> None:
        accepted.setblocking(False)
        self.socket = accepted
        self.unsent = memoryview(b"")
        self._answers = answers
        self._received = bytearray()

    def serve(self) -> None:
        """Take what has come, answer it, and send what can be sent.

        Raises
        ------
        OSError
            If the program is gone, or sends what can be no request.
        """
        with suppress(BlockingIOError):
            if not self.unsent:
                self._receive()
            if self.unsent:
                self.unsent = self.unsent[self.socket.send(self.unsent) :]

    def _receive(self) -> None:
        piece = self.socket.recv(PIECE)
        if not piece:
            raise ConnectionResetError
        self._received += piece
        lines = self._received.split(b"\n")
        self._received = lines.pop()
        if len(self._received) > LONGEST:
            raise ConnectionAbortedError
        self.unsent = memoryview(b"".join(self._answers.answer(bytes(line)) for line in lines))
