"""What is said between a served bench and the programs that use it, and what is not understood."""

import json
import os
import socket
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("termios", reason="pseudo-terminals are POSIX")

from simulators.bench import MARK_S, Bench, Detections, Mark, Syncs
from simulators.clock import BenchClock
from simulators.wire.harp import Timing
from simulators.wire.served.change_log import ChangeLog
from simulators.wire.served.detector import DetectorLine
from simulators.wire.served.server import BenchServer
from simulators.wire.served.terminal import Terminal
from simulators.wire.served.timing import ServedBench, TimingAnswers, TimingFaults
from simulators.wire.spad import SpadInstrument
from simulators.wire.tmc import TmcInterface

#: Any JSON, and objects that look like requests.
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=6),
    max_leaves=6,
)
ASKS = (
    *("who", "bulk_out", "bulk_in", "control", "clear_halt"),
    *("bench", "now", "count_rate", "detections", "syncs", "marks"),
)
KEYS = ("id", "data", "most", "request", "channel", "start_s", "stop_s", "before_s")
REQUESTS = st.builds(
    lambda ask, values: {"ask": ask, **values},
    st.sampled_from(ASKS),
    st.dictionaries(st.sampled_from(KEYS), VALUES),
)
LINES = st.binary(max_size=64) | (REQUESTS | VALUES).map(lambda value: json.dumps(value).encode("ascii"))
NESTED = b"[" * 100_000


def detector_line():
    return DetectorLine(TmcInterface(SpadInstrument(Bench())))


def timing_answers():
    return TimingAnswers(Bench(), TimingFaults(Timing(), 65535))


@given(LINES)
def test_every_line_to_the_detector_is_answered_with_one(line):
    line = line.replace(b"\n", b"")
    answer = detector_line().answer(line)
    assert answer.endswith(b"\n")
    assert "id" in json.loads(answer)


@given(LINES)
def test_every_line_to_the_timing_socket_is_answered(line):
    header, _, _ = timing_answers().take(line)().partition(b"\n")
    assert isinstance(json.loads(header), dict)


def test_what_is_nested_too_deep_is_refused():
    assert b"error" in detector_line().answer(NESTED)
    assert b"error" in timing_answers().take(NESTED)()


@pytest.mark.parametrize(
    "period", [(-1.0, 0.0), (0.5, 0.4), (0.0, 5.0), (float("nan"), 1.0), (0.0, float("inf"))], ids=str
)
def test_detections_of_unknown_times_are_refused(period):
    bench = Bench()
    bench.clock.sleep(1.0)
    request = {"ask": "detections", "start_s": period[0], "stop_s": period[1]}
    answer = TimingAnswers(bench, TimingFaults(Timing(), 65535)).take(json.dumps(request).encode())()
    assert "error" in json.loads(answer)


class Steady:
    """Photons that do not depend on anything."""

    def detections(self, laser_spot_m, light, duration_s, rng):
        return Detections(np.arange(4), np.linspace(0, 1e-8, 4))

    def rate_hz(self, laser_spot_m, light):
        return 4.0


def test_detections_arrive_as_they_were_drawn(tmp_path):
    bench = Bench([Steady()])
    bench.clock.sleep(1.0)
    faults = TimingFaults(Timing(dead_time_s=8e-8), 65535)
    with (
        answering(tmp_path / "timing", lambda line: TimingAnswers(bench, faults).take(line)()) as path,
        ServedBench(path) as there,
    ):
        assert there.faults == faults
        assert there.channels == bench.channels
        assert there.clock.now_s() == 1.0
        assert there.count_rate_hz(0) == 4.0
        (seen,) = there.detections(0.5, 1.0)
    (drawn,) = bench.detections(0.5, 1.0)
    np.testing.assert_array_equal(seen.pulse, drawn.pulse)
    np.testing.assert_array_equal(seen.time_s, drawn.time_s)


LIES = (
    *(b"", b"nonsense\n", b"[]\n", b'{"error": "no"}\n', b'{"photons": 3}\n', b'{"photons": []}\n'),
    *(b'{"photons": [-1]}\n', b'{"photons": [1e15]}\n', b'{"photons": [1]}\n12345678'),
)


@pytest.mark.parametrize("lie", LIES, ids=repr)
def test_a_server_that_talks_nonsense_is_gone(tmp_path, lie):
    honest = timing_answers()

    def answer(line):
        return lie if b"detections" in line else honest.take(line)()

    with (
        answering(tmp_path / "timing", answer) as path,
        ServedBench(path) as there,
        pytest.raises(ConnectionError),
    ):
        there.detections(0.0, 0.0)


def test_sync_pulses_and_marks_arrive_as_they_are(tmp_path):
    bench = Bench([Steady()])
    bench.clock.sleep(1.0)
    bench.change_light(emitting=True)
    bench.clock.sleep(1.0)
    bench.mark(5, 1.5, width_s=1e-3)
    bench.mark(1, 1.2)
    bench.mark(2, 3.0)
    answers = TimingAnswers(bench, TimingFaults(Timing(), 65535))
    with (
        answering(tmp_path / "timing", lambda line: answers.take(line)()) as path,
        ServedBench(path) as there,
    ):
        assert there.syncs_between(0.5, 2.0) == (Syncs(0.5, 1.0, 0.0), Syncs(1.0, 2.0, 10e6))
        assert there.take_marks(2.0) == (Mark(1.2, 1, MARK_S), Mark(1.5, 5, 1e-3))
        assert there.take_marks(2.0) == ()


@pytest.mark.parametrize("lie", [b"{}\n", b'{"syncs": [[1, 2]]}\n', b'{"syncs": [[1, 2, "x"]]}\n'], ids=repr)
def test_nonsense_about_sync_pulses(tmp_path, lie):
    honest = timing_answers()

    def answer(line):
        return lie if b"syncs" in line else honest.take(line)()

    with (
        answering(tmp_path / "timing", answer) as path,
        ServedBench(path) as there,
        pytest.raises(ConnectionError),
    ):
        there.syncs_between(0.0, 0.0)


class answering:  # noqa: N801 - used as a function
    """A socket at which each line gets an answer; it hangs up after an answer that is no whole document."""

    def __init__(self, path, answer):
        self._path, self._answer = str(path), answer

    def __enter__(self):
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(self._path)
        self._listener.listen()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()
        return self._path

    def __exit__(self, *_):
        self._thread.join(10)
        self._listener.close()

    def _serve(self):
        connection, _ = self._listener.accept()
        with connection, connection.makefile("rb") as lines:
            for line in lines:
                said = self._answer(line)
                connection.sendall(said)
                if b"detections" in line:
                    return


def test_a_terminal_never_waits_for_a_reader():
    class Talker:
        def __init__(self):
            self.output = bytearray()

        def receive(self, data):
            self.output += bytes(100_000)

    terminal = Terminal(Talker())
    try:
        far = os.open(terminal.address, os.O_RDWR | os.O_NOCTTY)
        os.write(far, b"x")
        terminal.serve()
        terminal.serve()  # nothing more has come
        assert len(os.read(far, 200_000)) > 0
        os.close(far)
    finally:
        terminal.close()


class Slow(Steady):
    """Photons that are drawn only when they may be."""

    def __init__(self):
        self.begun, self.may_end = threading.Event(), threading.Event()

    def detections(self, laser_spot_m, light, duration_s, rng):
        self.begun.set()
        assert self.may_end.wait(20)
        return super().detections(laser_spot_m, light, duration_s, rng)


def test_the_laser_answers_while_photons_are_drawn():
    slow = Slow()
    bench = Bench([slow], clock=BenchClock(real_time=True))
    with BenchServer(bench, TimingFaults(Timing(), 65535)) as server, ThreadPoolExecutor(2) as threads:
        running = threads.submit(server.run)
        try:
            with ServedBench(server.addresses.timing) as there:
                since_s = there.clock.now_s()
                seen = threads.submit(there.detections, since_s, there.clock.now_s())
                assert slow.begun.wait(20)
                with serial.Serial(server.addresses.laser, timeout=20) as port:
                    port.write(b"leg=1\nleg?\n")
                    assert port.readline() == b"leg=1\n"
                    assert port.readline() == b"leg status: 1\n"
                assert not seen.done()
                slow.may_end.set()
                assert len(seen.result(20)[0]) == 4
        finally:
            slow.may_end.set()
            server.stop()
        running.result(20)


def test_only_changes_are_logged():
    bench, told = Bench(), []
    bench.change_light(power=0.1)
    ChangeLog(bench, told.append)
    bench.change_light(power=0.5)
    bench.clock.sleep(0.25)
    bench.change_light(emitting=True)
    bench.change_light(emitting=True, gated=True)
    bench.steer(0.1, -0.2)
    bench.steer(0.1, -0.2)
    bench.change_light(emitting=False, biased=True)
    assert told == [
        "0.000 laser power 5.00\n",
        "0.250 laser emission 1\n",
        "0.250 galvo mirror 0.100000 -0.200000\n",
        "0.250 laser emission 0\n",
        "0.250 detector bias 1\n",
        "0.250 detector sensitive 1\n",
    ]
