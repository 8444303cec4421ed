"""The DAQ board of a served bench, for a program that scans: its methods over the socket of `timing`.

A request is one line of JSON. Samples are packed: raw little-endian numbers, deflated, in base64; levels of
lines are bytes of 0 and 1.

    {"ask": "board", "call": "identity"}                                        {"told": "NI PCIe-6343 ..."}
    {"ask": "board", "call": "fastest_hz", "analogue": true}                    {"told": 840000.0}
    {"ask": "board", "call": "set_lines", "names": [...], "values": [...]}      {"told": null}
    {"ask": "board", "call": "set_volts", "names": [...], "values": [...]}      {"told": null}
    {"ask": "board", "call": "play", "rate_hz": 2000.0, "samples": 46800, "lines": [...], "levels": "...",
     "channels": [...], "volts": "..."}                                         {"told": 2000.0}
    {"ask": "board", "call": "playing"}, and "stop"                             {"told": false}

What the board refuses gives ``{"refused": [code, "..."]}`` with NI-DAQmx's code.
"""

import base64
import zlib
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from simulators.wire.daq import NO_MEMORY, NOT_ACCESSIBLE, DaqFailure, SimulatedBoard
from simulators.wire.served.timing import ServedBench

#: Samples that a request takes, two for each tick: 2 MB of voltages that are all different.
MOST_SAMPLES = 200_000

_Value = TypeVar("_Value", bool, float)

_LEVEL, _VOLT = np.dtype("u1"), np.dtype("<f8")


class BoardAnswers:
    """The served side, for one program: what the board says to each request.

    Parameters
    ----------
    board
        The board.
    """

    def __init__(self, board: SimulatedBoard) -> None:
        self._board = board
        self._plays = False
        self._calls: dict[str, Callable[[dict[str, Any]], Any]] = {
            "identity": lambda request: board.identity(),
            "fastest_hz": lambda request: board.fastest_hz(analogue=bool(request["analogue"])),
            "set_lines": lambda request: board.set_lines(_names(request), _values(request, bool)),
            "set_volts": lambda request: board.set_volts(_names(request), _values(request, float)),
            "play": self._play,
            "playing": lambda request: board.playing(),
            "stop": lambda request: board.stop(),
        }

    def tell(self, request: dict[str, Any]) -> dict[str, Any]:
        """Do what is asked, and return the answer; raises one of `NO_REQUEST` where it is none."""
        try:
            return {"told": self._calls[request["call"]](request)}
        except DaqFailure as refused:
            return {"refused": [refused.error_code, str(refused)]}

    def leave(self) -> None:
        """End what this program plays: NI-DAQmx does so when a program ends."""
        if self._plays:
            self._board.stop()

    def _play(self, request: dict[str, Any]) -> float:
        lines, channels = _names(request, "lines"), _names(request, "channels")
        samples = int(request["samples"])
        levels = _unpacked(request["levels"], _LEVEL, samples, len(lines))
        volts = _unpacked(request["volts"], _VOLT, samples if channels else 0, len(channels))
        rate_hz = self._board.play(float(request["rate_hz"]), lines, levels != 0, channels, volts)
        self._plays = True
        return rate_hz


class ServedBoard:
    """A board on a bench in another process; satisfies what the driver asks of a board.

    Every method raises `DaqFailure` where the board refuses, or the server is gone.

    Parameters
    ----------
    address
        Path of the server's socket.

    Raises
    ------
    OSError
        If no server is there.
    """

    def __init__(self, address: str) -> None:
        self.name = f"served DAQ board at {address}"
        self._bench = ServedBench(address)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bench.__exit__(kind, error, trace)

    @property
    def most_samples(self) -> int:
        """How many samples it plays at one go."""
        return MOST_SAMPLES

    def identity(self) -> str:
        """Ask who it is."""
        return str(self._ask("identity"))

    def fastest_hz(self, *, analogue: bool) -> float:
        """Ask how many samples a second it plays."""
        return float(self._ask("fastest_hz", analogue=analogue))

    def set_lines(self, lines: Sequence[str], levels: Sequence[bool]) -> None:
        """Set lines to levels."""
        self._ask("set_lines", names=list(lines), values=[bool(level) for level in levels])

    def set_volts(self, channels: Sequence[str], volts: Sequence[float]) -> None:
        """Set channels to voltages."""
        self._ask("set_volts", names=list(channels), values=[float(one) for one in volts])

    def play(
        self,
        rate_hz: float,
        lines: Sequence[str],
        levels: NDArray[np.bool_],
        channels: Sequence[str],
        volts: NDArray[np.float64],
    ) -> float:
        """Play, soon; return the rate that it takes itself to have."""
        packed = {"levels": _packed(levels.astype(_LEVEL)), "volts": _packed(volts.astype(_VOLT))}
        if len(levels) > MOST_SAMPLES:
            raise DaqFailure(NO_MEMORY, "Not enough memory to perform the requested operation.")
        return float(
            self._ask(
                "play",
                rate_hz=rate_hz,
                samples=len(levels),
                lines=list(lines),
                channels=list(channels),
                **packed,
            )
        )

    def playing(self) -> bool:
        """Ask whether samples are still to come."""
        return bool(self._ask("playing"))

    def stop(self) -> None:
        """End what is played."""
        self._ask("stop")

    def let_go_of_volts(self) -> None:
        """Do nothing: no other program has them."""

    def _ask(self, call: str, **values: Any) -> Any:
        try:
            answer = self._bench.ask("board", call=call, **values)
        except ConnectionError as problem:
            raise DaqFailure(NOT_ACCESSIBLE, str(problem)) from problem
        match answer:
            case {"told": told}:
                return told
            case {"refused": [int(code), str(message)]}:
                raise DaqFailure(code, message)
        raise DaqFailure(NOT_ACCESSIBLE, f"the served board was asked for {call}, but answered {answer}")


def _packed(samples: NDArray[Any]) -> str:
    return base64.b64encode(zlib.compress(np.ascontiguousarray(samples).tobytes(), 1)).decode("ascii")


def _unpacked(text: str, dtype: np.dtype[Any], samples: int, columns: int) -> NDArray[Any]:
    """Return samples (samples, columns); ValueError where there are others."""
    if not 0 <= samples <= MOST_SAMPLES:
        raise ValueError(f"{samples} samples")
    size = samples * columns * dtype.itemsize
    try:
        content = zlib.decompressobj().decompress(base64.b64decode(text, validate=True), size + 1)
    except zlib.error as problem:
        raise ValueError(str(problem)) from problem
    if len(content) != size:
        raise ValueError(f"{len(content)} bytes are not {samples} samples of {columns} outputs")
    return np.frombuffer(content, dtype).reshape(samples, columns)


def _names(request: dict[str, Any], key: str = "names") -> list[str]:
    names = request[key]
    if not isinstance(names, list) or not all(isinstance(one, str) for one in names):
        raise TypeError(f"{key} is not a list of names")
    return names


def _values(request: dict[str, Any], kind: type[_Value]) -> list[_Value]:
    values = request["values"]
    if not isinstance(values, list):
        raise TypeError("the values are not a list")
    return [kind(one) for one in values]
