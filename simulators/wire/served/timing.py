"""What a timing instrument in another process asks of a served bench, over a local socket.

A request is one line of JSON. An answer is one line of JSON, and after that of ``detections``, for each
channel in turn, the pulses (int64) and the times (float64) of its photons, little-endian:

    {"ask": "bench"}                        {"channels": [...], "timing": {...}, "count_depth": 4294967295}
    {"ask": "now"}                                              {"now_s": 12.481}
    {"ask": "sync_rate"}                                        {"hz": 10000000.0}
    {"ask": "count_rate", "channel": 0}                         {"hz": 231456.2}
    {"ask": "syncs", "start_s": 12.4, "stop_s": 12.41}          {"syncs": [[12.4, 12.41, 10000000.0]]}
    {"ask": "marks", "before_s": 12.41}                         {"marks": [[12.402, 1, 1e-05]]}
    {"ask": "detections", "start_s": 12.4, "stop_s": 12.41}     {"photons": [2314]}, then 2314 * 16 bytes

Requests to the DAQ board, on the same socket, are told in `board`. What cannot be answered gives
``{"error": "..."}``. Times are the server's bench times.
"""

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, astuple, dataclass
from functools import partial
from types import TracebackType
from typing import Any, Self

import numpy as np

from simulators.bench import Bench, Channel, Detections, Mark, Syncs
from simulators.wire.harp import Nonlinearity, Pulses, Timing
from simulators.wire.served import NO_REQUEST
from simulators.wire.served.system import local_socket

#: Longest first line of a request or answer: the samples of 100,000 ticks of a DAQ board, see `board`.
LONGEST = 1 << 22

#: Longest wait for an answer [s]: drawing the photons of a long exposure takes a while.
ANSWER_S = 60.0

#: No exposure has more photons in a channel: 16 GB of them.
MOST_PHOTONS = 1 << 30

_PULSE, _TIME = np.dtype("<i8"), np.dtype("<f8")


@dataclass(frozen=True)
class TimingFaults:
    """How the timing instrument on this bench counts.

    Attributes
    ----------
    timing
        Faults of its clock.
    count_depth
        Largest count of a bin.
    """

    timing: Timing
    count_depth: int


class TimingAnswers:
    """The served side: what the bench says to each request.

    Parameters
    ----------
    bench, faults
        What is asked about.
    others
        What answers requests of other kinds, by what they ask.
    """

    def __init__(
        self,
        bench: Bench,
        faults: TimingFaults,
        others: Mapping[str, Callable[[dict[str, Any]], dict[str, Any]]] | None = None,
    ) -> None:
        self._bench = bench
        self._faults = faults
        self._others = others or {}

    def take(self, line: bytes) -> Callable[[], bytes]:
        """Take a line as of now; return what makes the answer.

        What is returned may take long, needs the bench no more, and may be called in another thread.
        """
        try:
            request = json.loads(line)
            if request["ask"] == "detections":
                return self._detections(*self._known(request))
            told = self._tell(request)
        except NO_REQUEST as problem:
            told = {"error": f"{type(problem).__name__}: {problem}"}
        return partial(_document, told)

    def _tell(self, request: dict[str, Any]) -> dict[str, Any]:
        ask, bench = request["ask"], self._bench
        if ask in self._others:
            return self._others[ask](request)
        if ask == "bench":
            return {"channels": [asdict(channel) for channel in bench.channels], **asdict(self._faults)}
        if ask == "now":
            return {"now_s": bench.clock.now_s()}
        if ask == "sync_rate":
            return {"hz": bench.sync_rate_hz()}
        if ask == "count_rate":
            return {"hz": bench.count_rate_hz(range(len(bench.channels))[int(request["channel"])])}
        if ask == "syncs":
            start_s, stop_s = self._known(request)
            return {"syncs": [astuple(one) for one in bench.syncs_between(start_s, stop_s)]}
        if ask == "marks":
            return {"marks": [astuple(one) for one in bench.take_marks(float(request["before_s"]))]}
        raise ValueError(f"{ask!r} is not a request")

    def _known(self, request: dict[str, Any]) -> tuple[float, float]:
        """Return the times of a request whose light and mirror are known."""
        start_s, stop_s = float(request["start_s"]), float(request["stop_s"])
        known_s, now_s = self._bench.known_from_s, self._bench.clock.now_s()
        if not known_s <= start_s <= stop_s <= now_s:
            raise ValueError(f"{start_s} to {stop_s} s is not within {known_s} to {now_s} s")
        return start_s, stop_s

    def _detections(self, start_s: float, stop_s: float) -> Callable[[], bytes]:
        draw = self._bench.drawing(start_s, stop_s)

        def answer() -> bytes:
            seen = draw()
            arrays = [array for one in seen for array in (one.pulse.astype(_PULSE), one.time_s.astype(_TIME))]
            header = _document({"photons": [len(one) for one in seen]})
            return b"".join([header, *(array.tobytes() for array in arrays)])

        return answer


def _document(told: dict[str, Any]) -> bytes:
    return json.dumps(told).encode("ascii") + b"\n"


class _ServedClock:
    def __init__(self, bench: "ServedBench") -> None:
        self._bench = bench

    def now_s(self) -> float:
        return self._bench.number("now_s", "now")


class ServedBench:
    """A bench in another process; satisfies `simulators.wire.harp.discriminators.MeasuredBench`.

    Every method raises ConnectionError if the server is gone or talks nonsense.

    Parameters
    ----------
    address
        Path of the server's socket.

    Attributes
    ----------
    channels, faults
        The detector's channels, and how the timing instrument counts.
    clock
        The bench's clock.

    Raises
    ------
    OSError
        If no server is there.
    """

    def __init__(self, address: str) -> None:
        self._socket = local_socket()
        try:
            self._socket.settimeout(ANSWER_S)
            self._socket.connect(address)
            self._stream = self._socket.makefile("rwb")
            told = self.ask("bench")
            self.channels = tuple(_channel(one) for one in told["channels"])
            self.faults = _faults(told)
        except (LookupError, TypeError, ValueError) as problem:
            self._socket.close()
            raise ConnectionError(f"no served bench answers ({problem!r})") from problem
        except BaseException:
            self._socket.close()
            raise
        self.clock = _ServedClock(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(OSError):  # what was not sent to a server that is gone
            self._stream.close()  # or it would keep the socket open
        self._socket.close()

    def sync_rate_hz(self) -> float:
        """Return the sync pulses a second, now."""
        return self.number("hz", "sync_rate")

    def count_rate_hz(self, channel: int) -> float:
        """Return the expected detections a second of a channel, by its number, now."""
        return self.number("hz", "count_rate", channel=channel)

    def detections(self, start_s: float, stop_s: float) -> tuple[Detections, ...]:
        """Draw what each channel saw between two bench times."""
        told = self.ask("detections", start_s=start_s, stop_s=stop_s)
        photons = told.get("photons")
        if not isinstance(photons, list) or len(photons) != len(self.channels):
            raise ConnectionError(
                f"{told} does not give the numbers of photons of {len(self.channels)} channels"
            )
        if not all(isinstance(one, int) and 0 <= one < MOST_PHOTONS for one in photons):
            raise ConnectionError(f"{photons} are not numbers of photons")
        return tuple(self._record(number) for number in photons)

    def syncs_between(self, start_s: float, stop_s: float) -> tuple[Syncs, ...]:
        """Return how sync pulses came between two bench times."""
        return tuple(
            Syncs(*map(float, one)) for one in self._triples("syncs", start_s=start_s, stop_s=stop_s)
        )

    def take_marks(self, before_s: float) -> tuple[Mark, ...]:
        """Take away the pulses at the marker inputs that begin before a time, in order."""
        marks = self._triples("marks", before_s=before_s)
        return tuple(Mark(float(at_s), int(mask), float(width_s)) for at_s, mask, width_s in marks)

    def _triples(self, what: str, **values: float) -> list[list[float]]:
        told = self.ask(what, **values).get(what)
        if not isinstance(told, list) or not all(_is_triple(one) for one in told):
            raise ConnectionError(f"the served bench was asked for {what}, but answered {told}")
        return told

    def number(self, name: str, what: str, **values: Any) -> float:
        """Return the number of this name in the answer to a request."""
        told = self.ask(what, **values)
        if not isinstance(told.get(name), int | float):
            raise ConnectionError(f"the served bench was asked for {what}, but answered {told}")
        return float(told[name])

    def ask(self, what: str, **values: Any) -> dict[str, Any]:
        """Return the answer to a request, without the arrays that may follow it."""
        try:
            self._stream.write(json.dumps({"ask": what, **values}).encode("ascii") + b"\n")
            self._stream.flush()
            line = self._stream.readline(LONGEST)
            answer = json.loads(line) if line else {"error": "it closed the connection"}
        except (OSError, ValueError) as problem:
            raise ConnectionError(f"the served bench is gone: {problem}") from problem
        if not isinstance(answer, dict) or "error" in answer:
            raise ConnectionError(f"the served bench was asked for {what}, but answered {answer}")
        return answer

    def _record(self, photons: int) -> Detections:
        pulse = np.frombuffer(self._bytes(photons * _PULSE.itemsize), _PULSE).astype(np.int64)
        return Detections(pulse, np.frombuffer(self._bytes(photons * _TIME.itemsize), _TIME).astype(float))

    def _bytes(self, number: int) -> bytes:
        try:
            data = self._stream.read(number)
        except OSError as problem:
            raise ConnectionError(f"the served bench is gone: {problem}") from problem
        if len(data) < number:
            raise ConnectionError(f"the served bench sent {len(data)} of {number} bytes")
        return data


def _is_triple(told: object) -> bool:
    return isinstance(told, list) and len(told) == 3 and all(isinstance(one, int | float) for one in told)


def _channel(told: dict[str, Any]) -> Channel:
    x_m, y_m, z_m = map(float, told["spot_m"])
    return Channel((x_m, y_m, z_m), int(told["input"]), float(told["delay_s"]))


def _faults(told: dict[str, Any]) -> TimingFaults:
    timing = dict(told["timing"])
    nonlinearity, pulses = Nonlinearity(**timing.pop("nonlinearity")), Pulses(**timing.pop("pulses"))
    return TimingFaults(Timing(**timing, nonlinearity=nonlinearity, pulses=pulses), int(told["count_depth"]))
