"""Answers that take their time, and bytes that nobody asked for."""

import pytest

from drivers.errors import LinkError, RefusedError
from drivers.katana.laser import KatanaLaser
from drivers.katana.settings import KatanaSettings
from drivers.lines.serial import SerialLine
from drivers.optotune import OptotuneMirror
from simulators.bench import Bench
from simulators.wire.galvo import GalvoBoard
from simulators.wire.laser import KatanaHead
from simulators.wire.serial_url import protocol_sim
from support.slow_wire import Slow


@pytest.fixture
def plug():
    """Plug firmware in, and out again at the end."""
    addresses = []

    def plug_in(firmware, clock):
        addresses.append(protocol_sim.attach(f"slow/{len(addresses)}", firmware, clock))
        return addresses[-1]

    yield plug_in
    for address in addresses:
        protocol_sim.detach(address)


def test_a_board_that_says_goodbye_to_pro_mode_late(plug):
    """Whether leaving Pro mode is answered is not known; if it is, START must not be answered by that."""

    class Polite(GalvoBoard):
        def receive(self, data):
            leaving = self._pro_mode
            super().receive(data)
            if leaving and not self._pro_mode:
                self.output += bytes.fromhex("7E 00 06 00 12 34 7E")

    bench = Bench()
    board = Polite(bench)
    board.receive(b"GOPRO\r\n")
    board.output.clear()
    address = plug(Slow(board, bench.clock, 0.1), bench.clock)
    with OptotuneMirror(address, clock=bench.clock, timeout_s=0.5) as mirror:
        assert mirror.identity == "MR-E-2 simulated, serial SIM0001"


@pytest.mark.parametrize("delay_s", [0.0, 0.02])
def test_a_laser_that_echoes_what_it_is_told_cannot_confirm_by_its_echo(plug, delay_s):
    class Echoing(KatanaHead):
        def _change(self, name, value):
            if name == "lp":
                return f"lp={value:.2f}\n"  # and does nothing
            return super()._change(name, value) or f"{name}={value:g}\n"

    bench = Bench()
    address = plug(Slow(Echoing(bench), bench.clock, delay_s), bench.clock)
    with (
        KatanaLaser(
            address, clock=bench.clock, settings=KatanaSettings(power=7.5, repetition_hz=10e6)
        ) as laser,
        pytest.raises(RefusedError, match=r"set lp=7\.50, but it kept lp=0"),
    ):
        laser.arm()


def line_to(address):
    return SerialLine(address, device="thing", baudrate=9600, terminator=b"\n", timeout_s=0.5)


class Echo:
    """Sends back what it receives."""

    def __init__(self):
        self.output = bytearray()

    def receive(self, data):
        self.output += data


def test_bytes_that_nobody_asked_for_are_thrown_away(plug):
    echo, clock = Echo(), Bench().clock
    line = line_to(plug(echo, clock))
    line.open()
    echo.output += b"hello, I have just been switched on\n"
    assert line.ask("first") == "first"
    echo.output += b"half a li"
    assert line.ask("second") == "second"
    line.close()


def test_an_answer_later_than_its_timeout_is_not_the_answer_to_the_next_question(plug):
    clock = Bench().clock
    slow = Slow(Echo(), clock, 0.7)
    line = line_to(plug(slow, clock))
    line.open()
    with pytest.raises(LinkError, match=r"no answer came in 0\.5 s"):
        line.ask("first")
    slow.delay_s = 0.0
    assert line.ask("second") == "second"
    line.close()


def test_a_line_without_end_is_given_up(plug):
    echo, clock = Echo(), Bench().clock
    line = line_to(plug(echo, clock))
    line.open()
    line.send(b"x" * 10_000)
    with pytest.raises(LinkError, match="only b'xxx"):
        line.receive("answer")
    line.close()


def test_lines_that_come_together_are_read_one_by_one(plug):
    echo, clock = Echo(), Bench().clock
    line = line_to(plug(echo, clock))
    line.open()
    line.send(b"one\ntwo\nthree")
    assert [line.receive("answer"), line.receive("answer")] == [b"one", b"two"]
    assert line.pending() == "three"
    assert line.pending() == ""
    line.close()


def test_an_address_is_taken_once(plug):
    clock = Bench().clock
    protocol_sim.detach(plug(Echo(), clock))
    path = "slow/twice"
    address = protocol_sim.attach(path, Echo(), clock)
    with pytest.raises(ValueError, match="detach it first"):
        protocol_sim.attach(path, Echo(), clock)
    protocol_sim.detach(address)
