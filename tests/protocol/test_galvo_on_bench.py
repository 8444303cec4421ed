"""The mirror's driver with the simulated board at the other end of the wire."""

import os
import threading
import time
from math import radians, tan

import numpy as np
import pytest

from drivers.clock import SystemClock
from drivers.errors import DeviceNotFoundError, LinkError, ProtocolError, RefusedError
from drivers.optotune import OptotuneMirror
from simulators.bench import Bench
from simulators.clock import BenchClock
from simulators.wire import galvo as board_bits
from simulators.wire.galvo import GalvoBoard
from simulators.wire.serial_url import protocol_sim


def test_the_mirror_stands_where_it_was_pointed(rig):
    x, y = radians(19.8), radians(-14.6)
    with rig.galvo() as mirror:
        mirror.point(x, y)
        mirror.wait_settled(timeout_s=0.1)
        angles = rig.bench.position_rad
    # Nine decimals of tan(50 degrees) on the wire: half of the last place is 0.6e-9.
    assert np.tan(angles) == pytest.approx((tan(x), tan(y)), abs=0.7e-9)


def test_waiting_lets_bench_time_pass_and_no_other(rig):
    with rig.galvo(poll_interval_s=1.0) as mirror:
        before_s, wall_s = rig.bench.clock.now_s(), time.monotonic()
        mirror.point(0.3, 0.0)
        mirror.wait_settled(timeout_s=100.0)
        # Moving at the first look, stable at the second and the third.
        assert rig.bench.clock.now_s() - before_s == pytest.approx(2.0)
    assert time.monotonic() - wall_s < 1.0


def test_a_mirror_that_does_not_settle_is_refused(rig):
    with rig.galvo() as mirror:
        mirror.point(0.3, 0.0)
        with pytest.raises(RefusedError, match=r"settle within 0\.002 s"):
            mirror.wait_settled(timeout_s=0.002)


@pytest.mark.parametrize(
    ("bits", "words"),
    [
        (board_bits.HEAD_DISCONNECTED, "head disconnected"),
        (board_bits.HEAD_TEMPERATURE | board_bits.MIRROR_TEMPERATURE, "head temperature, mirror temperature"),
        (board_bits.EEPROM_INVALID, "eeprom invalid"),
    ],
)
def test_a_fault_is_named_while_settling_and_on_connect(rig, bits, words):
    with rig.galvo() as mirror:
        mirror.point(0.1, 0.1)
        rig.board.break_down(bits)
        with pytest.raises(RefusedError, match=words):
            mirror.wait_settled(timeout_s=0.1)
    with pytest.raises(RefusedError, match=words), rig.galvo():
        pytest.fail("connected to a broken mirror")


@pytest.mark.parametrize("bit", [board_bits.OUTPUT_LIMIT, board_bits.AVERAGE_OUTPUT_LIMIT])
@pytest.mark.parametrize("over", [False, True])
def test_a_current_limit_is_a_fault_also_when_it_is_over(rig, bit, over):
    """While it was limited the mirror may have been anywhere; a new connection acknowledges it."""
    with rig.galvo() as mirror:
        mirror.point(0.1, 0.1)
        rig.board.break_down(bit)
        if over:
            rig.board.repair()
        with pytest.raises(RefusedError, match=r"output limit.*smaller or slower steps"):
            mirror.wait_settled(timeout_s=0.1)
    rig.board.repair()
    with rig.galvo() as mirror:
        mirror.point(0.1, 0.1)
        mirror.wait_settled(timeout_s=0.1)


class SilentBoard(GalvoBoard):
    """A firmware that says nothing to a command that it does not know."""

    def answer(self, line):
        return b"" if line == b"GETSN" else super().answer(line)


@pytest.mark.parametrize("kind", [GalvoBoard, SilentBoard])
def test_a_board_without_serial_number_is_taken_too(kind):
    bench = Bench()
    address = protocol_sim.attach("test/nameless", kind(bench, serial=None), bench.clock)
    try:
        with OptotuneMirror(address, clock=bench.clock) as mirror:
            assert mirror.identity == "MR-E-2 simulated"
            mirror.point(0.1, 0.1)
    finally:
        protocol_sim.detach(address)


def test_two_boards_are_told_apart_by_their_serial_numbers(rig):
    with rig.galvo(expected_identity="SIM0001") as mirror:
        assert mirror.identity.endswith("serial SIM0001")
    with pytest.raises(DeviceNotFoundError, match=r"SIM0002.*check galvo\.address and galvo\.serial"):
        rig.galvo(expected_identity="SIM0002").__enter__()


def test_a_line_that_echoes_is_told(rig):
    rig.board.echoes = True
    with pytest.raises(DeviceNotFoundError, match="switch the echo of this line or adapter off"):
        rig.galvo().__enter__()


def test_a_line_of_another_speed_is_told(rig, monkeypatch):
    """At another speed bytes arrive as others, many of them above 127."""
    receive = rig.board.receive

    def scrambled(data):
        receive(data)
        rig.board.output[:] = bytes(0xE0 | byte >> 3 for byte in rig.board.output or b"\0\0")

    monkeypatch.setattr(rig.board, "receive", scrambled)
    with pytest.raises(DeviceNotFoundError, match="speed is not 256000 baud"):
        rig.galvo().__enter__()


def test_past_faults_are_acknowledged_on_connect(rig):
    rig.board.break_down(board_bits.HEAD_TEMPERATURE)
    rig.board.repair()
    with rig.galvo() as mirror:
        assert mirror.status() == 0


def test_a_lost_answer_is_told_and_the_next_command_works(rig):
    with rig.galvo(timeout_s=0.5) as mirror:
        rig.board.drop_answers = 1
        before_s = rig.bench.clock.now_s()
        with pytest.raises(LinkError, match="no answer came"):
            mirror.point(0.1, 0.0)
        assert rig.bench.clock.now_s() - before_s == pytest.approx(0.5)
        mirror.point(0.2, 0.0)
        mirror.wait_settled(timeout_s=0.1)


def test_a_garbled_answer_is_told_and_the_next_command_works(rig):
    with rig.galvo() as mirror:
        rig.board.garble_answers = 1
        with pytest.raises(ProtocolError, match="'_K' came"):
            mirror.point(0.1, 0.0)
        mirror.point(0.2, 0.0)
        mirror.wait_settled(timeout_s=0.1)


def test_an_answer_that_comes_too_late_is_not_taken_for_the_next_one(rig):
    with rig.galvo() as mirror:
        rig.board.drop_answers = 1
        with pytest.raises(LinkError):
            mirror.point(0.1, 0.0)
        rig.board.output += b"OU\r\n"
        mirror.point(0.2, 0.0)


def test_the_mirror_is_at_rest_at_the_end(rig):
    with rig.galvo() as mirror:
        mirror.point(0.3, 0.2)
    assert rig.bench.target_rad == (0.0, 0.0)


def test_the_mirror_stays_where_it_is_after_an_exception(rig):
    """What failed may be what puts the light out: a lit beam must not sweep over the wall."""
    aimed_at = []

    def work():
        with rig.galvo() as mirror:
            mirror.point(0.3, 0.2)
            aimed_at.append(rig.bench.target_rad)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        work()
    assert [rig.bench.target_rad] == aimed_at != [(0.0, 0.0)]


def test_unplugged_in_the_middle(rig):
    def work():
        with rig.galvo() as mirror:
            rig.unplug_all()
            mirror.point(0.1, 0.0)

    with pytest.raises(LinkError, match="the connection broke") as raised:
        work()
    assert raised.value.asked.startswith("send b'XY=")


def test_unplugged_before_leaving(rig):
    with pytest.raises(LinkError, match=r"XY=0\.000000000"), rig.galvo():
        rig.unplug_all()


def test_another_board_at_the_address(rig):
    with pytest.raises(
        DeviceNotFoundError, match=r"'MR-E-2 number 2'.*it is 'MR-E-2 simulated, serial SIM0001'"
    ):
        rig.galvo(expected_identity="MR-E-2 number 2").__enter__()
    with rig.galvo(expected_identity="MR-E-2"):
        pass


def test_two_axes_outside_the_limits_of_the_board_are_trimmed_and_told(rig):
    """The driver's own check is passed by; the board says OU, and its status says trimmed."""
    rig.board.receive(b"XY=0.9;0.9\r\n")
    assert bytes(rig.board.output) == b"OU\r\n"
    x, y = np.tan(rig.bench.target_rad)
    assert x == y == pytest.approx(0.5**0.5 * tan(radians(50)))
    with rig.galvo() as mirror, pytest.raises(RefusedError, match="trimmed"):
        mirror.wait_settled(timeout_s=1.0)


def test_a_device_that_never_stops_talking_is_given_up():
    class Babbler:
        """Sends for ever."""

        def receive(self, data):
            pass

        @property
        def output(self):
            return bytearray(b"x" * 10_000)

    address = protocol_sim.attach("test/babbler", Babbler(), BenchClock())
    try:
        with pytest.raises(LinkError, match="sends without being asked"):
            OptotuneMirror(address, clock=BenchClock()).__enter__()
    finally:
        protocol_sim.detach(address)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="pseudo-terminals are a Unix thing")
def test_over_a_real_serial_port_of_the_operating_system():
    """The same board behind a pseudo-terminal: pyserial's own port, locked, opened, read and lost."""
    bench = Bench(clock=BenchClock(real_time=True))
    board = GalvoBoard(bench)
    ours, theirs = os.openpty()
    pytest.importorskip("tty").setraw(theirs)

    def pump():
        try:
            while data := os.read(ours, 1024):
                board.receive(data)
                os.write(ours, bytes(board.output))
                board.output.clear()
        except OSError:
            return  # the other end is closed

    thread = threading.Thread(target=pump, daemon=True)
    thread.start()
    address = os.ttyname(theirs)
    try:
        with OptotuneMirror(address, clock=SystemClock()) as mirror:
            mirror.point(0.1, -0.1)
            mirror.wait_settled(timeout_s=1.0)
            with pytest.raises(LinkError, match="another program uses it"):
                OptotuneMirror(address, clock=SystemClock()).__enter__()
        assert bench.target_rad == (0.0, 0.0)
    finally:
        os.close(theirs)
        thread.join(timeout=5.0)
        os.close(ours)


def test_nothing_at_the_address(tmp_path):
    for address in (str(tmp_path / "ttyACM0"), "sim://nowhere/galvo", "nonsense://x"):
        with pytest.raises(DeviceNotFoundError, match="steering mirror at"):
            OptotuneMirror(address, clock=BenchClock()).__enter__()
