"""``rig devices probe``: harmless, complete, without private details, and right about what is unconfirmed."""

import getpass
import json
import os
import re
import socket
import time
from pathlib import Path

import pytest

from drivers.daq.board import SharedBoard
from drivers.harp.library import HarpLibrary
from drivers.lines.listening import listening
from rig.acquire.probing.private import Placeholders
from rig.acquire.probing.run import ask_all, private_of
from rig.acquire.probing.transcript import DeviceTranscript, Recorder, json_lines, text_lines
from rig.devices.kinds import Wires
from rig.devices.probing.asking import Exchange
from rig.devices.probing.facts import FACTS, Verdict, verdict
from rig.devices.probing.questions import QUESTIONS
from rig.light.lock import locked
from rig.model.config import DaqClockConfig, RigConfig, load
from rig.model.config.kinds import ROLES
from simulators.wire.daq import DaqWiring, SimulatedBoard
from simulators.wire.dg645 import Dg645Box
from simulators.wire.harp import FAMILIES, HarpSimulator
from simulators.wire.laser import Katana08Head
from simulators.wire.mpd import MpdModule
from simulators.wire.nkt import NktMainboard
from simulators.wire.psd import PsdFirmware
from simulators.wire.serial_url import protocol_sim
from simulators.wire.t560 import T560Box
from support.served_bench import served
from support.simulated_rig import simulated_rig
from support.wire_script import Step, read_transcript

DOCS = Path(__file__).parents[2] / "docs"

#: Kinds that are no device, or cannot be asked.
NOT_ASKED = {
    ("tcspc", "playback"),
    ("laser", "external"),
    ("detector", "external"),
    ("delayer", "external"),
    ("shutter", "serial"),
}


def test_every_kind_has_its_questions():
    every = {(role, kind) for role, kinds in ROLES.items() for kind in kinds.kinds}
    assert set(QUESTIONS) == every - NOT_ASKED


# Harmless


#: What changes with each byte that comes and goes.
PASSING = {"output", "clock", "_bench", "_measured", "_input", "_heard_s"}


def state_of(rig):
    """All that a device remembers, the light, and where the mirror was sent."""
    firmware = [rig.board, rig.head, rig.instrument, *rig.heads.values()]
    remembered = [{k: repr(v) for k, v in vars(one).items() if k not in PASSING} for one in firmware]
    now_s = rig.bench.clock.now_s()
    return (
        remembered,
        rig.bench.light,
        rig.bench.mirror.target(now_s),
        rig.bench.mirror.commands_between(0, now_s),
    )


SIMULATED = [
    ("galvo", "optotune", "galvo_address"),
    ("laser", "katana", "laser_address"),
    ("laser", "katana-08hp", Katana08Head),
    ("laser", "nkt", NktMainboard),
    ("detector", "id120", "usb"),
    ("detector", "mpd", MpdModule),
    ("delayer", "psd", PsdFirmware),
    ("delayer", "dg645", Dg645Box),
    ("delayer", "t560", T560Box),
]


@pytest.fixture
def rig_on_bench():
    with simulated_rig() as rig:
        yield rig


HARPS = ("hydraharp", "multiharp", "picoharp330", "timeharp260", "hydraharp500")


def wires_to(rig, at=None):
    address = rig.plug_in("probed", at) if isinstance(at, type) else rig.laser_address
    board = SharedBoard(SimulatedBoard(rig.bench, DaqWiring((), None)))
    return Wires(
        galvo=rig.galvo_address,
        laser=address,
        detector=address,
        delayer=address,
        sync_hz=10e6,
        gate_hz=10e6,
        usb_backend=rig.usb,
        harp=lambda family: HarpLibrary(HarpSimulator(rig.bench, simulated(family)).functions, family),
        daq=lambda device: board,
        clock=rig.bench.clock,
    )


def simulated(family):
    return next(one for one in FAMILIES.values() if one.prefix == family.prefix)


def section_of(section, kind):
    config = RigConfig.model_validate({section: {"kind": kind}, "simulation": {}})
    return getattr(config, section)


@pytest.mark.parametrize(("section", "kind", "at"), SIMULATED)
def test_asking_changes_nothing(rig_on_bench, section, kind, at):
    """With light on, which a question must not put out either."""
    wires = wires_to(rig_on_bench, at)
    rig_on_bench.bench.change_light(emitting=True, power=0.5, biased=True)
    rig_on_bench.bench.mirror.command(0.1, 0.05, rig_on_bench.bench.clock.now_s())
    rig_on_bench.bench.clock.sleep(1e-3)
    before, changes = state_of(rig_on_bench), len(rig_on_bench.bench.changes)
    exchanges = list(QUESTIONS[section, kind](section_of(section, kind), wires))
    assert sum(one.answer is not None for one in exchanges) >= len(exchanges) - 2
    assert state_of(rig_on_bench) == before
    assert len(rig_on_bench.bench.changes) == changes


def test_no_question_is_an_order():
    """Katanas and SCPI instruments set by `name=value` and `NAME value`; the mirror's orders are known."""
    orders = {"XY", "X", "Y", "RESET", "GOPRO", "GOPROCRC", "ACKNOWLEDGE"}
    for asking in QUESTIONS.values():
        for question in getattr(asking, "questions", ()):
            assert "=" not in question
            assert " " not in question
            assert question not in orders


# Each failure is told, and the next device asked


def real(rig_on_bench, **changes):
    """A rig that is no simulated one for the program, with no USB and no vendor's library behind it."""
    sections = {
        "galvo": {"address": rig_on_bench.galvo_address},
        "laser": {"address": rig_on_bench.laser_address},
        "detector": {"kind": "id120"},
        "tcspc": {"library": "/nowhere/hhlib.so"},
    }
    return RigConfig.model_validate({**sections, **changes})


def test_one_device_after_the_other_whatever_fails(rig_on_bench):
    protocol_sim.detach(rig_on_bench.galvo_address)
    galvo, laser, detector, timing = ask_all(real(rig_on_bench), [])
    assert "no such port" in galvo.failure
    assert not laser.failure
    assert all(one.answer for one in laser.exchanges)
    assert detector.failure
    assert "could not be loaded" in timing.failure or "nothing could be loaded" in timing.failure


class Mute:
    """Firmware that never answers."""

    def __init__(self):
        self.output = bytearray()

    def receive(self, data):
        pass


def test_a_mute_device_is_given_up(rig_on_bench):
    protocol_sim.detach(rig_on_bench.laser_address)
    protocol_sim.attach("test/laser", Mute(), rig_on_bench.bench.clock)
    laser = list(ask_all(real(rig_on_bench), []))[1]
    assert len(laser.exchanges) == 3
    assert "no answer came" in laser.failure
    said = list(text_lines([laser], Placeholders()))
    assert any(line.startswith("> leg?") for line in said)
    assert not any(line.startswith("<") for line in said)


class Interrupting(Mute):
    """Ctrl-C comes while it is asked."""

    def receive(self, data):
        raise KeyboardInterrupt


def test_an_interrupt_keeps_what_was_asked(rig_on_bench, rig, tmp_path):
    protocol_sim.detach(rig_on_bench.laser_address)
    protocol_sim.attach("test/laser", Interrupting(), rig_on_bench.bench.clock)
    config = tmp_path / "lab.toml"
    addresses = {"galvo": rig_on_bench.galvo_address, "laser": rig_on_bench.laser_address}
    sections = [f'[{name}]\naddress = "{at}"\n' for name, at in addresses.items()]
    config.write_text("".join([*sections, '[detector]\nkind = "id120"\n']))
    done = rig("devices", "probe", "--config", config, "--out", "seen")
    assert done.code == 130, done.err
    assert "> STATUS" in (tmp_path / "seen" / "transcript.txt").read_text()


# The command


def test_the_simulated_rig(rig, tmp_path):
    done = rig("devices", "probe", "--out", "seen", "--json")
    assert done.code == 0, done.err
    document = json.loads(done.out)
    assert document["simulated"]
    assert [one["device"] for one in document["devices"]] == [
        "galvo",
        "laser",
        "detector",
        "delayer",
        "tcspc",
        "point_clock",
    ]
    assert {one["fact"] for one in document["facts"]} >= {"katana-05-leg", "optotune-status"}
    assert "prove nothing" in done.err
    lines = [json.loads(line) for line in (tmp_path / "seen" / "transcript.jsonl").read_text().splitlines()]
    assert lines[0]["format"] == "rig-probe"
    assert {"sent", "received"} <= {key for line in lines for key in line}
    times = [line["at_s"] for line in lines if "at_s" in line]
    assert times == sorted(times)
    again = rig("devices", "probe", "--out", "seen")
    assert again.code == 2
    assert "not overwritten" in again.err


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")
def test_served_devices_see_no_change(rig, tmp_path):
    """The server's log has a line for each change of light, power, bias and mirror."""
    with served(tmp_path) as bench:
        done = rig("devices", "probe", "--config", bench.config, "--out", "seen", "--json")
        assert done.code == 0, done.err
        assert bench.changes() == []
        said = (tmp_path / "seen" / "transcript.txt").read_text()
        for address in (bench.told["galvo"], bench.told["laser"], bench.told["timing"]):
            assert address not in said
        with locked(load(bench.config)):
            refused = rig("devices", "probe", "--config", bench.config, "--out", "other")
        assert refused.code == 4, refused.err
        assert "in use" in refused.err
        assert not (tmp_path / "other").exists()


def test_a_device_that_cannot_be_asked_is_exit_code_3(rig, tmp_path):
    (tmp_path / "lab.toml").write_text(
        '[galvo]\naddress = "/nowhere/ttyACM0"\n[laser]\naddress = "/nowhere/ttyUSB0"\n'
        '[detector]\nkind = "id120"\n'
    )
    done = rig("devices", "probe", "--config", "lab.toml", "--out", "seen")
    assert done.code == 3
    assert "at /nowhere/ttyACM0: asked to open the port, but there is no such port. Check power" in done.err
    assert "Errno" not in done.err
    said = (tmp_path / "seen" / "transcript.txt").read_text()
    assert "/nowhere" not in said
    assert "there is no such port" in said


def test_the_transcript_of_a_serial_line_reads_as_the_tests_own(rig_on_bench, tmp_path):
    galvo, *_ = ask_all(real(rig_on_bench), [])
    file = tmp_path / "galvo.txt"
    file.write_text("\n".join(text_lines([galvo], Placeholders())))
    steps = read_transcript(str(file))
    assert steps[:2] == [Step(">", b"START\r\n"), Step("<", b"OK\r\n")]


# Private details


SECRETS = {
    "galvo": "AK7301234",
    "detector": "DET-55021",
    "superk": "SIM0001",
    "port": "usb-FTDI_FT232R_A50285BI-if00-port0",
}


def probed(section, kind, settings, wires):
    """Ask one device at the end of these wires, and keep what passed."""
    device = DeviceTranscript(section, kind)
    recorder = Recorder(device, time.monotonic())
    with listening(recorder):
        for exchange in QUESTIONS[section, kind](settings, wires):
            recorder.exchanged(exchange)
        recorder.exchanged(None)
    return device


def test_nothing_private_is_left(rig_on_bench, monkeypatch):
    """Serial numbers in answers before they are known as such, in frames, in addresses and in failures."""
    monkeypatch.setattr(socket, "gethostname", lambda: "spadlab7.example.org")
    monkeypatch.setenv("USER", "mallory")
    monkeypatch.setenv("LOGNAME", "mallory")
    assert getpass.getuser() == "mallory"
    rig_on_bench.board.serial = SECRETS["galvo"]
    rig_on_bench.board.identity = f"MR-E-2 on spadlab7, board {SECRETS['galvo']}"
    rig_on_bench.instrument.serial_number = SECRETS["detector"]
    wires = wires_to(rig_on_bench, NktMainboard)
    config = real(
        rig_on_bench,
        name="mallory's rig",
        laser={"address": f"/dev/serial/by-id/{SECRETS['port']}"},
        tcspc={"library": "/home/mallory/hh/hhlib.so", "serial": "1044556"},
    )
    devices = [
        *ask_all(config, []),
        probed("detector", "id120", section_of("detector", "id120"), wires),
        probed("laser", "nkt", section_of("laser", "nkt"), wires),
        probed("tcspc", "hydraharp", section_of("tcspc", "hydraharp"), wires),
        probed("point_clock", "daq", DaqClockConfig(), wires),
    ]
    hidden = private_of(config, devices)
    said = "\n".join([*text_lines(devices, hidden), *json_lines(devices, hidden)])
    found = {name: text for name, text in SECRETS.items() if text in said or in_hexadecimal(text) in said}
    assert not found
    for secret in ("mallory", "spadlab7", "1044556", "1000001", "/home", "/dev/serial"):
        assert secret not in said
    assert in_hexadecimal(SECRETS["detector"]) in "\n".join(text_lines(devices, Placeholders()))
    (serial,) = set(re.findall(r"board (<serial \d>)", said))
    assert f"< {serial}" in said  # the answer to GETSN has the same one
    (detector,) = set(re.findall(r"ID120 simulated,(<serial \d>),", said))
    assert f"INFO:PRODUCT_SERIAL_NUMBER?: {detector}" in said


def in_hexadecimal(text):
    return text.encode().hex(" ")


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        ("HydraHarp 400, SN 1044556", "HydraHarp 400, SN <serial 1>"),
        ("SPAD (serial SIM0001) is gone", "SPAD (serial <serial 1>) is gone"),
        ("S/N: A50285BI", "S/N: <serial 1>"),
        ("cannot load /opt/hh/hhlib.so (/opt/hh/hhlib.so)", "cannot load <path 1> (<path 1>)"),
        (r"cannot load C:\lib\hhlib64.dll", "cannot load <path 1>"),
        ("no answer from 192.168.7.31", "no answer from <host 1>"),
        ("12/03/2019 at 10/12", "12/03/2019 at 10/12"),
        ("leg=<0|1>, leg? : emission", "leg=<0|1>, leg? : emission"),
        ("0.5 V/degree and/or", "0.5 V/degree and/or"),
    ],
)
def test_what_tells_itself_as_private(text, kept):
    hidden = Placeholders()
    hidden.learn_text(text)
    assert hidden.hidden(text) == kept


def test_a_version_in_an_answer_stays():
    hidden = Placeholders()
    hidden.learn_answer(Exchange("GETVERSION", "firmware 1.0.0.2"))
    assert hidden.hidden("firmware 1.0.0.2") == "firmware 1.0.0.2"


def test_a_name_is_hidden_where_it_is_a_word():
    hidden = Placeholders()
    hidden.learn("user", "lase")
    hidden.learn("serial", "77310")
    assert hidden.hidden("laser of lase, SN77310") == "laser of <user 1>, SN<serial 1>"


def test_a_serial_number_that_comes_with_words():
    hidden = Placeholders()
    asked = Exchange("GETSN", "SN=AK7301234 rev 2", private=True)
    hidden.learn_answer(asked)
    assert hidden.of_serial(asked) == "<serial 1>"
    assert hidden.hidden("board AK7301234, revision 2") == "board <serial 1>, revision 2"


def test_that_there_is_no_serial_number_is_no_secret_elsewhere():
    hidden = Placeholders()
    asked = Exchange("GETSN", "NO", private=True)
    hidden.learn_answer(asked)
    assert hidden.of_serial(asked) == "<serial>"
    assert hidden.hidden("NO") == "NO"


# What is settled


def answers_of(**said):
    """Answers by question; None: none came, `!TEXT`: it was refused as TEXT."""
    return {
        question: Exchange(question, None, (answer or "no answer came").lstrip("!"))
        if answer is None or answer.startswith("!")
        else Exchange(question, answer)
        for question, answer in said.items()
    }


#: Of each fact: answers that confirm it, and answers that contradict it.
JUDGED = {
    "optotune-getsn": ({"GETSN": "SN12345"}, {"GETSN": "NO"}),
    "optotune-status": ({"STATUS": "0x00000010"}, {"STATUS": "OK"}),
    "optotune-gettemp": ({"GETTEMP": "31.4"}, {"GETTEMP": "NO"}),
    "katana-05-leg": ({"leg?": "status: 0\n\r"}, {"leg?": "unknown command"}),
    "katana-05-lp": ({"lp?": "lp=5.00"}, {"lp?": "5.00"}),
    "katana-05-lps": ({"lps?": "status: 1"}, {"lps?": "power by knob"}),
    "katana-05-ltg": ({"ltg?": "ltg=0"}, {"ltg?": "ltg internal"}),
    "katana-05-ltg_freq": ({"ltg_freq?": "ltg_freq=10000000"}, {"ltg_freq?": "10 MHz"}),
    "katana-05-rate-unit": ({"ltg_freq?": "ltg_freq=10000000"}, {"ltg_freq?": "ltg_freq=10.0 MHz"}),
    "katana-05-help": ({"h": "leg=<0|1>\nlp=<xx.xx>"}, {"h": "unknown command"}),
    "katana-05-no-interlock": ({"h": "leg\nlp"}, {"h": "leg\nintlk? : Interlock state"}),
    "katana-08hp-le": ({"le?": "le status: 0"}, {"le?": "unknown command, h for help"}),
    "katana-08hp-lps": ({"lps?": "lps=1"}, {"lps?": None, "lip?": "lip=0"}),
    "katana-08hp-lts": ({"lts?": "lts=0"}, {"lts?": "unknown command", "lip?": "lip=0"}),
    "katana-08hp-lx_freq": ({"lx_freq?": "lx_freq=20000000"}, {"lx_freq?": "unknown command"}),
    "katana-08hp-dark": ({"le?": "le=0", "lpa?": "lpa=0.002"}, {"le?": "le=0", "lpa?": "lpa=0.031"}),
    "nkt-type": ({"type": "60"}, {"type": "61"}),
    "nkt-interlock": ({"interlock": "02 00"}, {"interlock": "07 00"}),
    "nkt-picker-width": ({"pulse picker": "08"}, {"pulse picker": "08 00"}),
    "nkt-no-picker": (
        {"pulse picker": "!it is not possible, or not allowed now", "type": "88"},
        {"pulse picker": None, "type": "88"},
    ),
    "nkt-emission-status": ({"emission": "00", "status": "00 00"}, {"emission": "03", "status": "00 00"}),
    "id120-idn": ({"*IDN?": "IDQ,ID120,1,2"}, {"*IDN?": "IDQ,SPAD-9,1,2"}),
    "id120-capability": (
        {"DEADTIME:CAPABILITY?": "40,1000000,40"},
        {"DEADTIME:CAPABILITY?": "1000000,40,40"},
    ),
    "id120-state": ({"REG:STATE?": "REGULATING"}, {"REG:STATE?": "3"}),
    "id120-flags": ({"REG:RUN?": "FALSE"}, {"REG:RUN?": "0"}),
    "id120-temperature": ({"REG:MEASURED_TEMP?": "-40000"}, {"REG:MEASURED_TEMP?": "-40.0"}),
    "mpd-status": (
        {"AQ;DC": "VPOL1#FR0#ERR0#VT-90#SE1#TS0#GF10000000#TO40000#TK2531#HO27#CT245#CE0#CC227#"},
        {"AQ;DC": "BIAS1#FR0#ERR0#GF10000000#TO40000#HO27#"},
    ),
    "psd-longest": ({"RMD": "RMD#49090#"}, {"RMD": "RMD#ERR1#"}),
    "psd-temperature": ({"RT": "55#"}, {"RT": "ERR1#"}),
    "psd-echo": ({"RD": "RD#120#"}, {"RD": "rd#120#"}),
    "dg645-numbers": ({"TLVL?": "+0.50"}, {"TLVL?": "0.50 V"}),
    "dg645-delay": ({"DLAY?2": "0,+0.000000025000"}, {"DLAY?2": "T0 +0.000000025000"}),
    "t560-id": ({"ID": "T560-2 Highland"}, {"ID": "OK"}),
    "t560-channel": (
        {"ASET": "Ch A  POS  ON     Dly  00.000,000,000,000  Wid  00.000,002,000,000"},
        {"ASET": "A POS ON 0 2n"},
    ),
    "t560-trigger": ({"TRIGGER": "POS"}, {"TRIGGER": "1"}),
    "t560-divider": ({"TDIV": "1"}, {"TDIV": "??"}),
    **{
        f"{kind}-not-initialized": (
            {f"{prefix}_GetFeatures(0)": "!NOT_INITIALIZED", f"{prefix}_GetLibraryVersion": "3.0"},
            {f"{prefix}_GetFeatures(0)": "7", f"{prefix}_GetLibraryVersion": "3.0"},
        )
        for kind, prefix in zip(HARPS, ("HH", "MH", "PH330", "TH260", "HH500"), strict=True)
    },
    "daq-lines": (
        {"fastest, lines": "10000000 Hz"},
        {"fastest, lines": "!-200452", "identity": "NI USB-6009"},
    ),
    "daq-channels": ({"fastest, lines and channels": "840000 Hz"}, {"fastest, lines and channels": "0 Hz"}),
}


def test_each_fact_is_judged_here():
    assert sorted(JUDGED) == sorted(fact.name for fact in FACTS)


@pytest.mark.parametrize("fact", FACTS, ids=lambda fact: fact.name)
def test_a_fact_is_settled_by_what_came(fact):
    confirming, contradicting = (answers_of(**said) for said in JUDGED[fact.name])
    assert fact.settled_by in confirming
    assert verdict(fact, confirming) is Verdict.CONFIRMED
    assert verdict(fact, contradicting) is Verdict.CONTRADICTED


@pytest.mark.parametrize("fact", FACTS, ids=lambda fact: fact.name)
def test_what_was_not_answered_settles_nothing(fact):
    assert verdict(fact, {}) is Verdict.NOT_SEEN
    assert verdict(fact, answers_of(**{fact.settled_by: None})) is Verdict.NOT_SEEN


def test_an_unseen_part_settles_nothing():
    """What an 08HP measures says nothing of darkness while nobody knows whether it emits."""
    facts = {fact.name: fact for fact in FACTS}
    lit = answers_of(**{"le?": "le=1", "lpa?": "lpa=0.800"})
    assert verdict(facts["katana-08hp-dark"], lit) is Verdict.NOT_SEEN
    assert verdict(facts["psd-echo"], answers_of(RD="120#")) is Verdict.NOT_SEEN
    assert verdict(facts["nkt-no-picker"], answers_of(**{"pulse picker": "08"})) is Verdict.NOT_SEEN
    assert verdict(facts["nkt-picker-width"], answers_of(**{"pulse picker": "00"})) is Verdict.NOT_SEEN


def test_each_fact_is_about_a_question_that_is_asked(rig_on_bench):
    asked = set()
    for section, kind, at in SIMULATED:
        wires = wires_to(rig_on_bench, at)
        for one in QUESTIONS[section, kind](section_of(section, kind), wires):
            asked.add((section, kind, one.question))
        rig_on_bench.heads.clear()
        protocol_sim.detach("sim://test/probed")
    wires = wires_to(rig_on_bench)
    harps = [("tcspc", kind) for kind in HARPS]
    for section, kind in (*harps, ("point_clock", "daq"), ("galvo", "analogue")):
        settings = DaqClockConfig() if section == "point_clock" else section_of(section, kind)
        asked |= {(section, kind, one.question) for one in QUESTIONS[section, kind](settings, wires)}
    assert {(fact.section, fact.kind, fact.settled_by) for fact in FACTS} <= asked


def test_each_fact_is_in_the_bench_notes():
    said = (DOCS / "bench.md").read_text(encoding="utf-8")
    assert [fact.name for fact in FACTS if f"`{fact.name}`" not in said] == []
