"""Attacks on everything that reads bytes of devices: whole drivers, behind whose wires anything may come.

PYTHONPATH=tests python -m attacks.wire --number 100000 [NAME...]
"""

import struct
from copy import deepcopy
from ctypes import CFUNCTYPE, c_int
from dataclasses import replace
from random import Random
from types import SimpleNamespace
from typing import Any

import serial
from usb.core import USBError, USBTimeoutError

from attacks.running import Attack, main
from attacks.spoiled import NUMBERS, spoiled_bytes
from drivers.delayers.dg645 import Dg645, Dg645Settings
from drivers.delayers.psd import Psd
from drivers.delayers.t560 import T560, T560Settings
from drivers.errors import DeviceError
from drivers.harp.device import Harp
from drivers.harp.families import HYDRAHARP_400
from drivers.harp.library import HarpLibrary
from drivers.harp.settings import HarpSettings
from drivers.harp.stream import HarpStream
from drivers.id120 import Id120Spad
from drivers.katana.dialects import KATANA_08HP
from drivers.katana.laser import KatanaLaser
from drivers.katana.settings import KatanaSettings
from drivers.mpd.detector import MpdSpad
from drivers.nkt.laser import NktLaser
from drivers.nkt.settings import NktSettings
from drivers.optotune import OptotuneMirror
from simulators.bench import Bench
from simulators.wire.dg645 import Dg645Box
from simulators.wire.nkt import NktMainboard
from simulators.wire.serial_url import protocol_sim
from simulators.wire.serial_url.protocol_sim import Firmware
from simulators.wire.t560 import T560Box
from support.harp_wire import C_TYPES, DECLARED, write
from support.protocol_noise import answers, next_answer
from support.scripted_usb import ScriptedUsb
from support.wire_script import StepClock

serial.protocol_handler_packages.append("support")

Table = dict[str, list[bytes]]

#: What a good device answers to each question, in turn, the last for ever.
GALVO: Table = {
    "START": [b"OK\r\n"],
    "GETID": [b"MR-E-2 board\r\n"],
    "GETSN": [b"12345\r\n"],
    "STATUS": [b"00000100\r\n", b"00000010\r\n", b"00000000\r\n"],
    "ACKNOWLEDGE": [b"OK\r\n"],
    "XY": [b"OK\r\n"],
}
LASER: Table = {
    "leg?": [*7 * [b"status: 0\n"], *3 * [b"status: 1\n"], b"status: 0\n"],
    "lps?": [*3 * [b"lps=1\n"], b"lps=0\n"],
    "ltg?": [b"ltg=0\n"],
    "ltg_freq?": [b"ltg_freq=10000000\n"],
    "lp?": [b"lp=5.00\n"],
    "lps": [b"lps=1\n"],
    "leg": [b""],
}
MEASURED_LASER: Table = {
    "lip?": [b"lip=0\n"],
    "le?": [b"unknown command\n"],
    "lpa?": [*7 * [b"lpa=0.000\n"], *3 * [b"lpa=0.800\n"], b"lpa=0.000\n"],
    "lps?": [*3 * [b"lps=1\n"], b"lps=0\n"],
    "lts?": [b"lts=0\n"],
    "lx_freq?": [b"lx_freq=20000000\n"],
    "lp?": [b"lp=0.800\n"],
    "lps": [b"lps=1\n"],
    "le": [b""],
}
SPAD: Table = {
    "*IDN?": [b"ID Quantique,ID120\n"],
    "REG:RUN?": [b"FALSE\n", b"TRUE\n", b"TRUE\n", b"FALSE\n"],
    "DEADTIME:CAPABILITY?": [b"40 1000000 40\n"],
    "DEADTIME:TIME?": [b"120\n"],
    "REG:STATE?": [b"OFF\n"],
    "BIAS:ERROR_STATUS?": [b"FALSE\n"],
    "BIAS:VOLTAGE?": [b"40000000\n"],
    "REG:MEASURED_TEMP?": [b"-40000\n"],
    "INFO:PRODUCT_NAME?": [b"ID120\n"],
    "INFO:PRODUCT_SERIAL_NUMBER?": [b"S1\n"],
    "INFO:FIRMWARE_VERSION?": [b"1.0\n"],
}


CLOSED = b"VPOL1#FR0#ERR0#VT100#SE1#TS0#GF0#TO10000#TK2530#HO27#CT150#CE82#CC228#"
OPEN = CLOSED.replace(b"TO10000", b"TO40000")
MPD: Table = {
    "AQ;DC#": [CLOSED, CLOSED, CLOSED, OPEN, OPEN, CLOSED],
    "TS0;GM;AD#": [b"TS0#"],
    "TO10000;AD#": [b"TO10000#"],
    "TO40000;AD#": [b"TO40000#"],
}
PSD: Table = {
    "EM0#": [b"EM0#0#"],
    "EM1#": [b"1#"],
    "RMD#": [b"49090#"],
    "RP#": [b"1#", b"11#"],
    "RD#": [b"0#", b"20500#"],
    "EO0#": [b"0#"],
    "EO1#": [b"1#"],
    "SV1#": [b"1#"],
    "SP10#": [b"11#"],
    "SD20500#": [b"20500#"],
}


def spoiled(random: Random, good: Table) -> Table:
    """Return a table of answers of which some are spoiled."""
    table = {question: list(said) for question, said in good.items()}
    for question in random.sample(sorted(table), random.randint(1, 3)):
        at = random.randrange(len(table[question]))
        said = table[question][at]
        end = next(end for end in (b"\r\n", b"#", b"\n", b"") if said.endswith(end)) or b"\n"
        number = random.choice(NUMBERS).encode()
        table[question][at] = random.choice(
            [
                spoiled_bytes(random, said),
                number + end,
                said.split(b"=")[0].strip() + b"=" + number + end,
                b"",
                b"(Error " + number + b")" + end,
                said * 100,
                b"x" * 5000,
                random.randbytes(30) + end,
                b"\x1b[31m\0" + said,
            ]
        )
    return table


def read_galvo(said: Table) -> None:
    """Connect, point, settle and ask for the settings."""
    answers["galvo"] = deepcopy(said)
    with OptotuneMirror("noise://galvo", clock=StepClock(), timeout_s=0.01) as mirror:
        mirror.point(0.1, 0.1)
        mirror.wait_settled(0.1)
        mirror.settings()


def read_laser(said: Table) -> None:
    """Connect, arm, emit, ask for the settings."""
    _read_katana(said, KatanaSettings(power=5.0, repetition_hz=10e6))


def read_measured_laser(said: Table) -> None:
    """The same with the laser whose light is known by what it measures."""
    _read_katana(said, KatanaSettings(model=KATANA_08HP, power=0.8, repetition_hz=20e6))


def _read_katana(said: Table, settings: KatanaSettings) -> None:
    answers["laser"] = deepcopy(said)
    with KatanaLaser("noise://laser", clock=StepClock(), settings=settings, timeout_s=0.01) as laser:
        laser.arm()
        laser.emit()
        laser.settings()


class Spoiling:
    """Firmware on a wire on which some answers are spoiled."""

    def __init__(self, firmware: Firmware, random: Random) -> None:
        self.firmware, self.random, self.output = firmware, random, bytearray()

    def receive(self, data: bytes) -> None:
        self.firmware.receive(data)
        said = bytes(self.firmware.output)
        self.firmware.output.clear()
        chance = self.random.random()
        if chance < 0.05:
            said = spoiled_bytes(self.random, said)
        elif chance < 0.08:
            said = self.random.randbytes(30) + b"\n"
        self.output += said


def read_superk(seed: int) -> None:
    """Connect, arm, emit, ask for the settings: the light is out in the end, or that it is not is told."""
    bench = Bench()
    wire = Spoiling(NktMainboard(bench), Random(seed))
    address = protocol_sim.attach("attacked/superk", wire, bench.clock)
    settings = NktSettings(level_percent=40.0, oscillator_hz=80e6, repetition_hz=10e6)
    try:
        with NktLaser(address, clock=bench.clock, settings=settings) as laser:
            laser.arm()
            laser.emit()
            laser.settings()
        assert not bench.light.emitting
    finally:
        protocol_sim.detach(address)


def delayer(name: str, box: Any, driver: Any, settings: Any) -> Attack:
    """Return the attack on a gate delayer: set, switched on, asked, and left."""

    def read(seed: int) -> None:
        bench = Bench()
        wire = Spoiling(box(bench), Random(seed))
        address = protocol_sim.attach(f"attacked/{name}", wire, bench.clock)
        told: DeviceError | None = None
        try:
            with driver(address, settings=settings) as opened:
                opened.set_delay(10e-9)
                opened.enable()
                assert bench.light.triggered
                opened.settings()
        except DeviceError as problem:
            told = problem
        finally:
            protocol_sim.detach(address)
        # a gate that may go on is told
        assert not bench.light.triggered or "RUNNING" in f"{told} {getattr(told, '__notes__', '')}"
        if told is not None:
            raise told

    return Attack(name, lambda random: random.randrange(10**9), read, (DeviceError,))


class NoisyUsb(ScriptedUsb):
    """A USBTMC device whose answers are given, in good frames or spoiled ones."""

    def __init__(self, said: Table, seed: int | None) -> None:
        self.random = Random(seed)
        self.noisy = seed is not None
        super().__init__([], packet=self.random.choice([64, 64, 64, 512, 8, 0]) if self.noisy else 64)
        self.said, self.asked, self.tag = deepcopy(said), "", 1

    def bulk_write(self, handle, ep, intf, data, timeout):
        self.tag = data[1]
        if data[0] == 1:
            self.asked = bytes(data[12:]).rstrip(b"\0\n").decode("ascii")
        return len(data)

    def bulk_read(self, handle, ep, intf, buff, timeout):
        message = next_answer(self.said, self.asked)
        head = bytes([2, self.tag, 255 - self.tag, 0]) + struct.pack("<IB3x", len(message), 1)
        frame = head + message
        if self.noisy and self.random.random() < 0.1:
            frame = spoiled_bytes(self.random, frame)
            if self.random.random() < 0.2:
                frame = (
                    head[:4] + struct.pack("<IB3x", self.random.choice([0, 2**32 - 1, 10**6]), 0) + bytes(600)
                )
        if self.noisy and self.random.random() < 0.05:
            raise self.random.choice(
                [USBTimeoutError("late", -7, 110), USBError("gone", -4, 19), USBError("pipe", -9, 32)]
            )
        frame = frame[: len(buff)]
        buff[: len(frame)] = type(buff)("B", frame)
        return len(frame)

    def ctrl_transfer(self, handle, kind, request, value, index, data, timeout):
        good = bytes([1]) + bytes(len(data) - 1)
        came = (
            good
            if not self.noisy or self.random.random() < 0.9
            else spoiled_bytes(self.random, good)[: len(data)]
        )
        data[: len(came)] = type(data)("B", came)
        return len(came)


def read_spad(given: tuple[Table, int | None]) -> None:
    """Connect, switch on, ask for the settings."""
    said, seed = given
    backend = NoisyUsb(said, seed)
    with Id120Spad(backend=backend, clock=StepClock(), timeout_s=0.01) as spad:
        spad.enable()
        spad.settings()


def read_mpd(said: Table) -> None:
    """Connect, open the gate, ask for the settings."""
    answers["mpd"] = deepcopy(said)
    with MpdSpad("noise://mpd", clock=StepClock(), timeout_s=0.01) as detector:
        detector.enable()
        detector.settings()


def read_psd(said: Table) -> None:
    """Connect, set a delay, switch the output on, ask for the settings."""
    answers["psd"] = deepcopy(said)
    with Psd("noise://psd", clock=StepClock(), timeout_s=0.01) as delayer:
        delayer.set_delay(31.5e-9)
        delayer.enable()
        delayer.settings()


#: What a good HydraHarp writes into the pointers of its functions.
HARP: dict[str, tuple[Any, ...]] = {
    "HH_GetLibraryVersion": ("3.0",),
    "HH_OpenDevice": ("1000001",),
    "HH_GetHardwareInfo": ("HydraHarp 400", "930010", "2.0"),
    "HH_GetBaseResolution": (1.0, 26),
    "HH_GetNumOfInputChannels": (2,),
    "HH_SetHistoLen": (16384,),
    "HH_GetResolution": (4.0,),
    "HH_CTCStatus": (1,),
    "HH_GetSyncRate": (10_000_000,),
    "HH_GetCountRate": (200_000,),
    "HH_GetFlags": (0,),
    "HH_GetWarnings": (0,),
    "HH_GetWarningsText": ("no warning",),
    "HH_GetHardwareDebugInfo": ("all well",),
    "HH_GetHistogram": (0,),
    "HH_GetFeatures": (0x07,),
    "HH_ReadFiFo": (0, 0),
}
_FLOATS = [0.0, -1.0, float("nan"), float("inf"), float("-inf"), 1e308, 5e-324, 1e-9, 4.0000001, -0.0]
_INTS = [0, -1, 1, 2**31 - 1, -(2**31), 65536, 1024, 255, 3, 64, 10**6]
_TEXTS = ["", "3.0", "\x1b[31m", "x" * 15, "\udc80".encode("utf-8", "surrogateescape"), "%s%n"]


def harp(random: Random) -> dict[str, Any]:
    """Return what a library writes, a few functions spoiled, and the codes it returns."""
    said: dict[str, Any] = dict(HARP)
    for name in random.sample(sorted(HARP), random.randint(1, 3)):
        said[name] = tuple(
            random.choice(_FLOATS if isinstance(one, float) else _INTS if isinstance(one, int) else _TEXTS)
            for one in said[name]
        )
    codes = (
        {random.choice(sorted(DECLARED)): random.choice([-1, -37, -99, 1, 2**31 - 1])}
        if random.random() < 0.2
        else {}
    )
    return {"writes": said, "codes": codes}


def read_harp(given: dict[str, Any]) -> None:
    """Open, measure, ask for rates, warnings and settings."""
    with Harp(
        _library(given),
        clock=StepClock(),
        serial="1000001",
        settings=replace(HarpSettings(family=HYDRAHARP_400), bins=1024),
    ) as instrument:
        instrument.measure(0.001)
        rates = instrument.rates()
        assert rates.sync_hz >= 0
        assert rates.input_hz >= 0
        instrument.warnings()
        settings = instrument.settings()
        assert settings["bin_width_s"] > 0


def read_stream(given: dict[str, Any]) -> None:
    """Open in time-tagged mode, and take what is recorded."""
    with HarpStream(_library(given), clock=StepClock(), serial="1000001") as stream:
        stream.start(0.001)
        number = 0
        for piece in stream.pieces():
            assert piece.first == number
            number += len(piece.records)


def _library(given: dict[str, Any]) -> HarpLibrary:
    writes = given["writes"]
    # a good measurement runs when it is first asked for, and is over at the next
    states = iter([(0,)] if writes["HH_CTCStatus"] == HARP["HH_CTCStatus"] else [])

    def function(name: str) -> Any:
        def call(*arguments: Any) -> int:
            if code := given["codes"].get(name, 0):
                return code
            pointers = [one for one in arguments if not isinstance(one, int)]
            written = writes.get(name, ())
            if name == "HH_CTCStatus":
                written = next(states, written)
            for pointer, value in zip(pointers, written, strict=False):
                write(pointer, value + b"\0" if isinstance(value, bytes) else value)
            return 0

        return CFUNCTYPE(c_int, *(C_TYPES[c_type] for c_type in DECLARED[name]))(call)

    return HarpLibrary(SimpleNamespace(**{name: function(name) for name in DECLARED}), HYDRAHARP_400)


def spad(random: Random) -> tuple[Table, int | None]:
    """Return answers, and the seed of what else goes wrong on the bus, None where nothing does."""
    kind = random.random()
    return spoiled(random, SPAD) if kind < 0.7 else SPAD, random.randrange(10**9) if kind > 0.4 else None


ATTACKS = (
    Attack("galvo", lambda random: spoiled(random, GALVO), read_galvo, (DeviceError,)),
    Attack("laser", lambda random: spoiled(random, LASER), read_laser, (DeviceError,)),
    Attack(
        "laser that measures",
        lambda random: spoiled(random, MEASURED_LASER),
        read_measured_laser,
        (DeviceError,),
    ),
    Attack("superk", lambda random: random.randrange(10**9), read_superk, (DeviceError,)),
    delayer("dg645", Dg645Box, Dg645, Dg645Settings(pulse_width_s=20e-9, repetition_hz=5e6)),
    delayer("t560", T560Box, T560, T560Settings(pulse_width_s=20e-9, repetition_hz=5e6)),
    Attack("detector", spad, read_spad, (DeviceError,)),
    Attack("mpd", lambda random: spoiled(random, MPD), read_mpd, (DeviceError,)),
    Attack("psd", lambda random: spoiled(random, PSD), read_psd, (DeviceError,)),
    Attack("hydraharp", harp, read_harp, (DeviceError,)),
    Attack("hydraharp stream", harp, read_stream, (DeviceError,)),
)

if __name__ == "__main__":
    main(ATTACKS)
