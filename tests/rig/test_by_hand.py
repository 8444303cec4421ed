"""Devices without a data interface on the simulated rig: what a person is asked, what is believed."""

import io
import json
import sys
from contextlib import ExitStack, contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest

from drivers.daq.board import SharedBoard
from drivers.errors import RefusedError as DeviceRefusedError
from drivers.harp.library import HarpLibrary
from rig.acquire.connect import devices_on
from rig.bench.operator import SimulatedOperator
from rig.bench.simulated import simulated_instruments
from rig.commands.operator import ConsoleOperator
from rig.devices.by_hand import DetectorByHand
from rig.devices.kinds import Wires
from rig.errors import RefusedError, UsageError
from rig.files.scan import ScanFile
from rig.model.config import ExternalDetectorConfig, built_in_with, load

CONFIGS = Path(__file__).parents[2] / "configs"

DETECTOR = '[detector]\nkind = "external"\nmodel = "PDM"\n'
LASER = '[laser]\nkind = "external"\nmodel = "diode"\n'
DAQ_SHUTTER = '[shutter]\nkind = "daq"\nline = "port1/line0"\n'
PORT_SHUTTER = '[shutter]\nkind = "serial"\nread_back = "cts"\n'
SIMULATION = "[simulation]\nseed = 3\n"
SMALL = ("--grid", "6x4", "--spacing", "25cm")


class Person(SimulatedOperator):
    """A person at the bench, who may say yes without doing it."""

    def __init__(self, bench, ignores=(), refuses=()):
        super().__init__(bench)
        self.asked = []
        self.told = []
        self._ignores, self._refuses = ignores, refuses

    def set_by_hand(self, wanted, meanwhile=lambda: False):
        self.asked.append(wanted.words)
        if any(word in wanted.words for word in self._refuses):
            raise RefusedError("the person says no")
        if any(word in wanted.words for word in self._ignores):
            return "a liar"
        return super().set_by_hand(wanted, meanwhile)

    def tell(self, words):
        self.told.append(words)


@contextmanager
def at_the_bench(config, **habits):
    """Open the devices of a simulated rig with a person of ours; give devices, person and bench."""
    bench, instruments = simulated_instruments(config)
    bench.warm_up()
    board = SharedBoard(instruments.daq)
    person = Person(bench, **habits)
    with ExitStack() as stack:
        stack.enter_context(instruments)
        wires = Wires(
            galvo=instruments.galvo_url,
            laser=instruments.laser_url,
            usb_backend=instruments.usb_backend,
            harp=lambda family: HarpLibrary(instruments.harp, family),
            daq=lambda device: board,
            clock=bench.clock,
            sync_hz=config.laser.repetition_hz,
            gate_hz=config.gate_hz,
            detector=instruments.detector_url,
            delayer=instruments.delayer_url,
            shutter=instruments.shutter_url,
            operator=person,
        )
        yield stack.enter_context(devices_on(config, wires)), person, bench


def written(text):
    Path("rig.toml").write_text(text)
    return load(Path("rig.toml"))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def scanned(rig, text, *options):
    Path("rig.toml").write_text(text)
    done = rig("scan", "--config", "rig.toml", "--out", "s.h5", *SMALL, *options)
    assert done.code == 0, done.err
    return done


@pytest.mark.parametrize(
    "text",
    [
        LASER,
        LASER + DAQ_SHUTTER,
        LASER + PORT_SHUTTER,
        LASER + DETECTOR,
        DETECTOR,
        DAQ_SHUTTER,
        DETECTOR + '[delayer]\nkind = "external"\n',
        DETECTOR + '[delayer]\nkind = "t560"\ninsertion_delay = "21ns"\n',
    ],
    ids=["laser", "shutter", "port", "both", "detector", "katana behind a shutter", "delayer", "t560"],
)
def test_a_scan_with_what_has_no_interface_is_the_same_scan(rig, text):
    """Who sets the rig does not change its photons: they are those of the built-in rig, to the last."""
    usual = "[laser]\npower_setpoint = 10.0\n" if LASER not in text else ""
    scanned(rig, text + usual + SIMULATION)
    rig("scan", "--seed", 3, "--out", "usual.h5", *SMALL)
    with ScanFile(Path("s.h5")) as one, ScanFile(Path("usual.h5")) as other:
        np.testing.assert_array_equal(one.counts(range(one.steps)), other.counts(range(one.steps)))
        assert one.photons > 1000


def test_the_file_says_what_was_set_by_hand_and_who_says_so(rig):
    scanned(rig, DETECTOR + LASER + SIMULATION)
    with ScanFile(Path("s.h5")) as scan:
        told = [note.sentence for note in scan.events if note.kind == "by hand"]
        assert any("no program can switch it off" in sentence for sentence in told)
        assert any("bias, gate and hold-off of the detector" in sentence for sentence in told)
        assert scan.devices["spad"]["answer"] == "the simulated person"
        assert scan.devices["spad"]["gate_delay_s"] == pytest.approx(31.5e-9)
        assert scan.devices["laser"]["switched"] == "by hand"
        assert scan.devices["laser"]["evidence"] == "there were sync pulses only with the light"
        dark = [note.sentence for note in scan.events if note.kind == "light"][-1]
    assert "as reported by a person" in dark
    assert "read back" not in dark


def test_the_dry_run_and_json_say_what_cannot_be_verified(rig):
    Path("rig.toml").write_text(DETECTOR + LASER + DAQ_SHUTTER + SIMULATION)
    plan = rig("scan", "--config", "rig.toml", "--dry-run")
    assert "not verified" in plan.out
    assert "the light counts as on" in plan.out
    plan = json.loads(rig("scan", "--config", "rig.toml", "--dry-run", "--json").out)
    assert len(plan["unverified"]) == 2
    done = scanned(rig, DETECTOR + LASER + DAQ_SHUTTER + SIMULATION, "--json")
    assert json.loads(done.out)["unverified"] == plan["unverified"]
    assert "warning: the laser's own emission and power are not known" in done.err
    usual = json.loads(rig("scan", "--dry-run", "--json").out)
    assert usual["unverified"] == []


def test_a_detector_is_asked_about_once_and_again_where_something_changes(folder):
    with at_the_bench(written(DETECTOR + SIMULATION)) as (devices, person, bench):
        assert devices.spad.by_hand == {"bias", "hold_off", "gate_delay", "gate_width"}
        devices.spad.enable()
        devices.spad.disable()
        devices.spad.enable()
        assert len(person.asked) == 1
        assert "bias on; gated, open from 31.5 ns after the sync pulse for 40 ns" in person.asked[0]
        devices.spad.set_gate(35e-9, 30e-9)
        devices.spad.set_hold_off(200e-9)
        assert len(person.asked) == 1  # asked before the next light, in one question
        devices.spad.enable()
        assert "from 35 ns after the sync pulse for 30 ns; hold-off 200 ns" in person.asked[1]
        light = bench.light
        assert (light.gate_delay_s, light.gate_width_s, light.hold_off_s) == (35e-9, 30e-9, 200e-9)
        assert light.biased
    assert len(person.asked) == 2
    assert bench.light.biased  # nobody but a person can change that


def test_a_detector_that_nobody_confirms_is_not_used(folder):
    config = written(DETECTOR + SIMULATION)
    with (
        at_the_bench(config, refuses=("detector",)) as (devices, _, bench),
        pytest.raises(RefusedError, match="says no"),
    ):
        devices.spad.enable()
    assert not bench.light.biased


def test_a_free_running_detector_is_asked_about_as_that(folder):
    with at_the_bench(written(DETECTOR + "gated = false\n" + SIMULATION)) as (devices, person, bench):
        devices.spad.enable()
        assert "bias on; free running; hold-off" in person.asked[0]
        assert not bench.light.gated


def test_a_delayer_by_hand_is_asked_for_the_delay_without_what_cables_add(folder):
    text = DETECTOR + '[delayer]\nkind = "external"\nmodel = "box"\ninsertion_delay = "11.5ns"\n' + SIMULATION
    with at_the_bench(written(text)) as (devices, person, _):
        assert devices.spad.by_hand == {"bias", "hold_off", "gate_width"}
        devices.spad.enable()
        assert any("(box) to 20 ns, its output on" in words for words in person.asked)
        assert devices.spad.settings()["delayer_answer"] == "the simulated person"
        asked = len(person.asked)
        devices.spad.set_gate(36.5e-9, 40e-9)
        assert any("(box) to 25 ns" in words for words in person.asked[asked:])


def test_behind_a_delayer_a_person_sets_no_delay_at_the_detector(folder):
    """The box adds 21 ns by itself, of which the configuration knows 11: the gate opens 10 ns late."""
    text = DETECTOR + '[delayer]\nkind = "t560"\ninsertion_delay = "11ns"\n' + SIMULATION
    with at_the_bench(written(text)) as (devices, person, bench):
        devices.spad.enable()
        assert "gated by its trigger input, open for 40 ns" in person.asked[0]
        assert bench.light.gate_delay_s == pytest.approx(41.5e-9, abs=1e-12)
        assert bench.light.sensitive
        devices.spad.disable()
        assert not bench.light.sensitive  # biased as before, but no gate opens
    assert not bench.light.triggered


@pytest.mark.parametrize("text", [LASER, LASER + DAQ_SHUTTER], ids=["by hand", "shutter"])
def test_a_laser_that_was_not_switched_on_is_not_believed(folder, text):
    config = written(text + SIMULATION)

    def lit():
        with at_the_bench(config, ignores=("ON",)) as (devices, _, _):
            devices.laser.arm()
            devices.laser.emit()

    with pytest.raises(DeviceRefusedError, match="the sync rate is 0 Hz"):
        lit()


def test_a_laser_at_another_rate_is_not_believed(folder):
    config = written(LASER + SIMULATION)
    with at_the_bench(config) as (devices, person, bench):
        bench.change_light(repetition_hz=20e6)
        devices.laser.arm()
        with pytest.raises(DeviceRefusedError, match="asked to pulse at 10 MHz, but the sync rate is 20 MHz"):
            devices.laser.emit()
        assert "OFF" in person.asked[-1]  # it may be on: it is asked to be switched off
        assert not bench.light.emitting


def test_a_laser_by_hand_that_pulses_on_is_told_as_emitting(folder):
    """The person says that it is off, and the pulses that came with the light go on."""
    config = written(LASER + SIMULATION)

    def used():
        with at_the_bench(config, ignores=("OFF",)) as (devices, _, _):
            devices.laser.arm()
            devices.laser.emit()
            assert devices.laser.emitting()
            with pytest.raises(DeviceRefusedError, match=r"still counts 10 MHz.*Treat the laser as EMITTING"):
                devices.laser.stop()
            assert devices.laser.emitting()

    with pytest.raises(DeviceRefusedError, match="EMITTING"):  # on leaving, too
        used()


def test_nobody_who_answers_is_overruled_by_pulses_that_end(folder):
    """Pulses that came with the light and have ended tell more than an answer."""
    with at_the_bench(written(LASER + SIMULATION), refuses=("OFF",)) as (devices, _, bench):
        devices.laser.arm()
        devices.laser.emit()
        bench.change_light(emitting=False)
        devices.laser.stop()
        assert not devices.laser.emitting()


def test_pulses_that_were_there_before_prove_nothing(folder):
    config = written(LASER + SIMULATION)
    with at_the_bench(config) as (devices, person, bench):
        bench.change_light(emitting=True, shuttered=True)  # as a laser with a shutter of its own
        devices.laser.arm()
        devices.laser.emit()
        assert devices.laser.settings()["evidence"].startswith("none")
        devices.laser.stop()
        assert "OFF" in person.asked[-1]


def test_pulses_that_were_there_before_and_nobody_who_answers_is_emitting(folder):
    config = written(LASER + SIMULATION)

    def used():
        with at_the_bench(config, refuses=("OFF",)) as (devices, _, bench):
            bench.change_light(emitting=True)
            devices.laser.arm()
            devices.laser.emit()

    with pytest.raises(DeviceRefusedError, match=r"the person says no.*EMITTING"):
        used()


def test_behind_a_shutter_the_person_is_asked_once_while_it_is_closed(folder):
    config = written(LASER + DAQ_SHUTTER + SIMULATION)
    with at_the_bench(config) as (devices, person, bench):
        assert len(person.asked) == 1
        assert bench.light.emitting
        assert bench.light.on_wall == 0
        for _ in range(2):
            devices.laser.arm()
            assert bench.light.on_wall == 0
            devices.laser.emit()
            assert bench.light.on_wall == 1
            assert devices.laser.emitting()
            devices.laser.stop()
            assert bench.light.on_wall == 0
            assert not devices.laser.emitting()
        assert len(person.asked) == 1
    assert bench.light.emitting  # the laser itself goes on, and that is told
    assert any("only its shutter blocks the light" in words for words in person.told)


def test_a_laser_with_an_interface_is_made_dark_by_both(folder):
    config = built_in_with({"laser": {"power_setpoint": 10.0}, "shutter": {}})
    with at_the_bench(config) as (devices, person, bench):
        devices.laser.arm()
        devices.laser.emit()
        assert bench.light.on_wall == 1
        assert devices.laser.settings()["shutter_open"] is True
        devices.laser.stop()
        assert not bench.light.emitting
        assert bench.light.shuttered
        assert person.asked == []


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            LASER + DAQ_SHUTTER.replace("port1/line0", "port0/line1") + "[point_clock]\n",
            "a line of point_clock",
        ),
        (DAQ_SHUTTER + "open_level = 1\n", "shutter.open_level"),
        ('[shutter]\nkind = "relay"\n', "choose among 'daq', 'serial'"),
        ('[delayer]\nkind = "t560"\npulse_width = "0s"\n', "delayer.pulse_width"),
        (LASER + "power_setpoint = 3\n", "power_setpoint"),
    ],
)
def test_a_wrong_section_is_refused_in_words(rig, text, told):
    Path("rig.toml").write_text(text + SIMULATION)
    done = rig("scan", "--config", "rig.toml", "--dry-run")
    assert done.code == 2
    assert told in done.err


def test_a_delayer_that_cannot_follow_the_laser_is_refused_before_anything_is_opened(rig):
    Path("rig.toml").write_text('[delayer]\nkind = "dg645"\n' + SIMULATION)
    done = rig("scan", "--config", "rig.toml", "--dry-run")
    assert done.code == 4
    assert "must end within 0 ns at 10 MHz" in done.err


def test_without_anybody_there_a_real_rig_refuses(monkeypatch):
    config = load(CONFIGS / "external.toml")
    assert isinstance(config.detector, ExternalDetectorConfig)
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    with (
        DetectorByHand(config.detector, ConsoleOperator()) as detector,
        pytest.raises(UsageError, match=r"a person must be at the rig.*--yes answers in scripts"),
    ):
        detector.enable()
    with DetectorByHand(config.detector, None) as detector, pytest.raises(RefusedError, match="must be at"):
        detector.enable()


def test_the_example_is_scanned_as_it_comes(rig):
    done = rig("scan", "--config", CONFIGS / "external.toml", "--out", "s.h5", *SMALL)
    assert done.code == 0, done.err
    with h5py.File("s.h5") as file:
        assert "MPD PDM" in file["devices/spad"].attrs["identity"]
        assert "port1/line0" in file["devices/laser"].attrs["identity"]
        assert bool(file["devices/laser"].attrs["shutter_open"])
