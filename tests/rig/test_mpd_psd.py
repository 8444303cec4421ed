"""A rig whose detector is an MPD Fast-Gated SPAD with a Picosecond Delayer, from configuration to picture."""

import json
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest

from drivers.errors import DeviceError, LimitError, RefusedError
from rig.acquire.acquisition import Watch, acquire, interrupted, record, resume
from rig.acquire.connect import devices_on
from rig.acquire.events import Ended, Noticed, PhaseChanged
from rig.bench.simulated import simulated_instruments
from rig.devices.delayed_gate import DelayedGate
from rig.errors import DoubtError
from rig.errors import RefusedError as RigRefusedError
from rig.files.scan import ScanFile
from rig.model.config import RigConfig, built_in_with, load
from rig.model.plan import Pass, ScanPlan, Spots
from rig.model.state import RigState
from support.simulated_wires import wires_to

RIG = {
    "detector": {"kind": "mpd"},
    "delayer": {"kind": "psd"},
    "tcspc": {"kind": "hydraharp", "bins": 1500, "bin_width": "32ps"},
    "calibration": {"use": False},
}


def configured(**sections) -> RigConfig:
    return built_in_with({**RIG, **sections})


def plan_of(config, exposure_s=5e-3):
    return ScanPlan.grid(config, columns=3, rows=2, spacing_m=0.2, exposure_s=exposure_s, skip_m=0.0)


class Opened:
    """An open rig, and what is behind its wires."""

    def __init__(self, config, bench, instruments, devices):
        self.config, self.bench, self.instruments, self.devices = config, bench, instruments, devices
        self.events = []

    def scan(self, folder: Path, plan=None) -> Path:
        plan, path = plan or plan_of(self.config), folder / "scan.h5"
        record(plan, RigState(self.config), self.devices, path, Watch(consumers=(self.events.append,)))
        return path

    def told(self, kind):
        return [event.sentence for event in self.events if isinstance(event, Noticed) and event.kind == kind]


@contextmanager
def opened(**sections):
    config = configured(**sections)
    bench, instruments = simulated_instruments(config)
    bench.warm_up()
    with instruments, devices_on(config, wires_to(config, bench, instruments)) as devices:
        yield Opened(config, bench, instruments, devices)


def test_detector_and_delayer_are_one_gated_detector(tmp_path):
    with opened() as rig:
        spad = rig.devices.spad
        assert isinstance(spad, DelayedGate)
        assert spad.by_hand == {"bias", "hold_off"}
        assert (rig.bench.light.gate_delay_s, rig.bench.light.triggered) == (31.5e-9, False)
        with ScanFile(rig.scan(tmp_path)) as scan:
            assert scan.done.all()
            assert scan.photons > 1000
            said = scan.devices["spad"]
            assert said["gate_delay_s"] == 31.5e-9
            assert (said["gate_width_s"], said["hold_off_s"]) == (40e-9, 100e-9)
            assert (said["biased"], said["gated"], said["gate_rate_hz"]) == (True, True, 10e6)
            assert said["delayer_pulse_width_s"] + said["delayer_fine_delay_s"] == pytest.approx(31.5e-9)
            assert "Picosecond Delayer" in said["identity"]
        light = rig.bench.light
        assert (light.emitting, light.triggered, light.gated, light.gate_width_s) == (
            False,
            False,
            True,
            10e-9,
        )
        assert light.biased
        assert not light.sensitive
        assert rig.told("bias") == [
            "the detector stays BIASED, as set by a person: its bias can only be switched off by hand"
        ]
        assert rig.told("warning") == []


def test_the_photons_are_those_of_any_detector_that_is_gated_so(tmp_path):
    """A bench whose gate is set by nobody's driver, at the same delay, width and hold-off."""
    with opened() as rig:
        path = rig.scan(tmp_path)
        plan = plan_of(rig.config)
        with ScanFile(path) as scan:
            counted = scan.counts(range(scan.steps))[:, 0].sum(axis=1)
    bench, _ = simulated_instruments(rig.config)
    light = {"emitting": True, "power": 1.0, "biased": True, "gated": True, "triggered": True}
    bench.change_light(**light, gate_delay_s=31.5e-9, gate_width_s=40e-9, hold_off_s=100e-9)
    for index, spot in enumerate(RigState(rig.config).pointing.angles_rad(plan.spots_m)):
        bench.steer(*spot)
        bench.clock.sleep(0.1)
        begin_s = bench.clock.now_s()
        bench.clock.sleep(5e-3)
        seen = bench.detections(begin_s, bench.clock.now_s())[0]
        # the instrument misses what falls into its dead time or beyond its bins: less than a tenth
        assert 0.9 * len(seen) <= counted[index] <= len(seen)


def test_the_delay_is_set_while_no_pulse_leaves_the_delayer():
    with opened() as rig:
        spad, seen = rig.devices.spad, []
        rig.bench.watchers.append(
            lambda now_s: seen.append((rig.bench.light.triggered, rig.bench.light.gate_delay_s))
        )
        spad.enable()
        spad.set_gate(50e-9, 30e-9)
        spad.disable()
    delays = [triggered for (triggered, delay_s), (_, before_s) in zip(seen[1:], seen, strict=False)
              if delay_s != before_s]  # fmt: skip
    assert delays
    assert not any(delays)
    assert (True, 50e-9) in seen


@pytest.mark.parametrize(("insertion_s", "asked_ns"), [(0.0, 31.5), (20e-9, 11.5), (35e-9, 96.5)])
def test_what_cable_and_delayer_add_is_taken_off(insertion_s, asked_ns):
    """Where too little is left, the gate follows the pulse before: 100 ns more."""
    with opened(delayer={"kind": "psd", "insertion_delay": f"{insertion_s * 1e9}ns"}) as rig:
        assert rig.bench.light.gate_delay_s == pytest.approx(asked_ns * 1e-9, abs=5e-12)
        assert rig.devices.spad.settings()["gate_delay_s"] == pytest.approx(31.5e-9, abs=5e-12)


def test_a_delay_that_no_period_makes_possible_is_refused():
    with (
        pytest.raises(LimitError, match=r"129\.09 ns.*It was not sent"),
        opened(detector={"kind": "mpd", "gate_delay": "250ns"}),
    ):
        pytest.fail("opened")


def test_free_running_leaves_the_delayer_off(tmp_path):
    with opened(detector={"kind": "mpd", "gated": False}) as rig:
        with ScanFile(rig.scan(tmp_path)) as scan:
            assert scan.devices["spad"]["gated"] is False
        assert not rig.bench.light.triggered


def test_without_a_delayer_the_cable_makes_the_delay(tmp_path):
    config = configured().model_copy(update={"delayer": None})
    bench, instruments = simulated_instruments(config)
    with instruments, devices_on(config, wires_to(config, bench, instruments)) as devices:
        assert "gate_delay" in devices.spad.by_hand
        assert bench.light.gate_delay_s == 31.5e-9
        devices.spad.set_gate(31.5e-9, 20e-9)
        with pytest.raises(RefusedError, match=r"trigger cable opens it at 31\.5 ns.*\[delayer\]"):
            devices.spad.set_gate(30e-9, 20e-9)


@pytest.mark.parametrize(
    ("by_hand", "told"),
    [
        ({"bias": False}, "the bias is off.*MPD's program, switch the bias on"),
        ({"error": 3}, "it reports error 3"),
        ({"hold_off": "80ns"}, "hold off for 100 ns.*about 81 ns"),
    ],
)
def test_what_a_person_has_not_set_ends_the_scan_before_there_is_light(tmp_path, by_hand, told):
    with opened(simulation={"by_hand": by_hand}) as rig:
        lit = []
        rig.bench.watchers.append(lambda now_s: lit.append(rig.bench.light.emitting))
        with pytest.raises(RefusedError, match=told):
            rig.scan(tmp_path)
        assert not any(lit)


def test_a_gate_that_does_not_follow_the_laser_is_noticed_in_the_light(tmp_path):
    with opened() as rig:
        rig.instruments.detector.gate_hz = 0.0
        with pytest.raises(RigRefusedError, match=r"gate opens at 0 Hz, but the laser is set to 10 MHz"):
            rig.scan(tmp_path)
        assert not rig.bench.light.emitting


def test_a_gate_whose_rate_is_counted_late_is_waited_for(tmp_path):
    """The detector counts the gate for a second before it tells another rate."""
    with opened() as rig:
        detector, since = rig.instruments.detector, []
        detector.gate_hz = 0.0

        def lit(now_s):
            if rig.bench.light.emitting and not since:
                since.append(now_s)

        rig.bench.watchers.append(lit)
        answer = detector.answer

        def counted(line):
            if since and rig.bench.clock.now_s() - since[0] > 1.0:
                detector.gate_hz = None
            return answer(line)

        detector.answer = counted
        with ScanFile(rig.scan(tmp_path)) as scan:
            assert scan.done.all()


def test_a_scan_of_an_earlier_program_is_read_and_taken_up_again(tmp_path):
    """There the detector was an ID120 with commands for a gate; its photons are those of the MPD detector."""
    config = configured()
    whole, cut = tmp_path / "whole.h5", tmp_path / "cut.h5"
    plan = plan_of(config)
    for path in (whole, cut):
        acquire(plan, RigState(config), path)
    with h5py.File(cut, "r+") as file:
        told = json.loads(file["start"].attrs["configuration"])
        del told["delayer"]
        told["detector"] |= {"kind": "id120", "serial": None, "excess_bias_v": 5.0}
        file["start"].attrs["configuration"] = json.dumps(told)
        file["devices/spad"].attrs["identity"] = "ID Quantique,ID120 simulated,SIM0001,1.0"
        done = file["transients/done"][()]
        done[3:] = False
        file["transients/done"][...] = done
        del file["stop"]
    with ScanFile(cut) as scan:
        assert (scan.config.detector.kind, scan.config.detector.gated) == ("mpd", True)
    resume(*interrupted(cut), cut)
    with ScanFile(cut) as found, ScanFile(whole) as wanted:
        assert found.done.all()
        steps = range(found.steps)
        assert np.array_equal(found.counts(steps), wanted.counts(steps))


@pytest.mark.parametrize(
    ("happens", "told"),
    [
        (lambda rig: rig.bench.change_light(biased=False), "nothing was recorded.*check the detector"),
        (lambda rig: setattr(rig.instruments.detector, "error", 5), "spad error is 5, was 0"),
        (lambda rig: setattr(rig.instruments.detector, "gate_hz", 9e6), r"spad gate_rate_hz is 9000000\.0"),
        (lambda rig: rig.bench.change_light(hold_off_s=60e-9), "spad hold_off_s is 6"),
        (lambda rig: rig.instruments.delayer.receive(b"SD0#"), "spad gate_delay_s is"),
    ],
    ids=["bias", "error", "rate", "hold-off", "delay"],
)
def test_what_changes_while_a_scan_runs_ends_it_and_is_taken_back(tmp_path, happens, told):
    with opened() as rig:

        def late(event):
            if isinstance(event, PhaseChanged) and event.phase.value == "exposing":
                happens(rig)

        path = tmp_path / "scan.h5"
        watch = Watch(consumers=(rig.events.append, late))
        with pytest.raises(DoubtError, match=told):
            record(plan_of(rig.config), RigState(rig.config), rig.devices, path, watch)
        assert not rig.bench.light.emitting
        assert not rig.bench.light.triggered
        assert [event.steps_done for event in rig.events if isinstance(event, Ended)] == [0]


def test_too_much_light_closes_what_can_be_closed_and_calls_for_a_hand(tmp_path):
    with opened(detector={"kind": "mpd", "max_count_rate": "1kHz"}) as rig:
        with pytest.raises(DoubtError, match="IT CANNOT SWITCH OFF THE BIAS: SWITCH IT OFF BY HAND, NOW"):
            rig.scan(tmp_path)
        light = rig.bench.light
        assert (light.emitting, light.triggered, light.gate_width_s) == (False, False, 10e-9)


class Person:
    """Sets at the bench what is asked for, and says so."""

    def __init__(self, bench):
        self.bench, self.asked = bench, []

    def set_by_hand(self, wanted, meanwhile=lambda: False):
        self.asked.append(wanted.words)
        self.bench.change_light(**wanted.settings)
        return "a person"


def test_hold_offs_are_set_by_a_person_and_set_back(tmp_path):
    config = configured(detector={"kind": "mpd", "gated": False})
    bench, instruments = simulated_instruments(config)
    passes = tuple(
        Pass(name=str(hold_s), positions=Spots(spots=((0.1, 0.0, 0.0),)), exposure_s=5e-3, hold_off_s=hold_s)
        for hold_s in (90e-9, 160e-9)
    )
    person = Person(bench)
    with instruments:
        from dataclasses import replace

        wires = replace(wires_to(config, bench, instruments), operator=person)
        with devices_on(config, wires) as devices:
            record(ScanPlan(passes=passes), RigState(config), devices, tmp_path / "dark.h5")
    assert [words.partition("hold-off to ")[2].partition(",")[0] for words in person.asked] == [
        "90 ns",
        "160 ns",
        "100 ns",
    ]
    assert bench.light.hold_off_s == 100e-9
    with ScanFile(tmp_path / "dark.h5") as scan:
        assert [one.devices["spad"]["hold_off_s"] for one in scan.passes()] == [90e-9, 160e-9]


@pytest.mark.parametrize("fails", ["detector", "delayer"])
def test_whatever_does_not_obey_is_named_and_the_other_is_closed(fails):
    def work():
        with opened() as rig:
            rig.devices.spad.enable()
            device = getattr(rig.instruments, fails)
            if fails == "detector":
                device._set["FR"], device.gate_stuck = 1, True
            else:
                device.output_stuck = True
            bench.append(rig.bench)

    bench = []
    with pytest.raises(DeviceError) as raised:
        work()
    said = "\n".join([str(raised.value), *getattr(raised.value, "__notes__", [])])
    assert ("SENSITIVE and BIASED" if fails == "detector" else "switch the delayer off by hand") in said
    if fails == "detector":
        assert not bench[0].light.triggered
    else:
        assert bench[0].light.gate_width_s == 10e-9


def rig_command(folder, *arguments):
    command = [sys.executable, "-m", "rig", *map(str, arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=280)


CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize("name", ["mpd_psd", "mpd_dg645"])
def test_the_example_scans_and_images(tmp_path, name):
    """From the commented example to a picture."""
    config = CONFIGS / f"{name}.toml"
    assert load(config).simulated
    scan = ["scan", "--config", config, "--grid", "24x18", "--spacing", "7cm", "--exposure", "10ms"]
    done = rig_command(tmp_path, *scan, "--out", "a.h5", "--json")
    assert done.returncode == 0, done.stderr
    assert "stays BIASED" in done.stderr
    assert json.loads(done.stdout)["status"] == "complete"
    done = rig_command(tmp_path, "recon", "a.h5", "--image", "a.png", "--json")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.png").stat().st_size > 10_000
    with ScanFile(tmp_path / "a.h5") as found:
        assert np.count_nonzero(found.done) == found.steps
