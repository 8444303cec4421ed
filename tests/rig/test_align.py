"""Aligning: light by the rules of a scan, where it was asked for; what is shown is what is there."""

import json
import os
import signal
import subprocess
import time
from types import SimpleNamespace

import numpy as np
import pytest

from attacks.scene import attacked_rig, tiny_config
from drivers.errors import DeviceError
from rig.acquire.acquisition import Watch
from rig.acquire.alignment import align_on, circle, lap, laps
from rig.acquire.connect import devices_on
from rig.acquire.events import Ended, LightChanged, Ready, StepCut, StepDone
from rig.errors import DoubtError, UsageError
from rig.model.config import load
from rig.model.plan import Step
from rig.model.state import RigState
from rig.show.levels import Histogram, Levels
from support.served_bench import rig_command, served

CONFIG = tiny_config()
SPOT = (0.3, -0.1, 0.0)
#: A busy machine may need longer to start, and longer than the half second that is promised; not for ever.
PATIENCE_S = 60.0


class Aligned:
    """An alignment on a bench in this process: its levels, events, and how the bench was left."""

    def __init__(self, spots=(SPOT,), longest_s=2.0, after=None, do=lambda rig: None, config=CONFIG):
        self.events, self.levels, self.error = [], Levels(len(spots)), None
        state = RigState(config)
        once = lap(spots, 0.05)
        with attacked_rig(config) as rig:

            def watched(event):
                self.events.append(event)
                if isinstance(event, StepDone) and event.step.index == after:
                    do(rig)

            try:
                with devices_on(config, rig.wires) as devices:
                    watch = Watch([self.levels, watched], begun=self.levels.begun)
                    align_on(devices, laps(once, longest_s), state, longest_s, watch)
            except Exception as error:
                self.error = error
            self.light = rig.bench.light
            angles = state.pointing.angles_rad(np.array(spots[0]))
            rig.bench.steer(*angles)
            rig.bench.clock.sleep(1.0)
            rig.bench.change_light(
                emitting=True, power=1.0, biased=True, gated=True, triggered=True, gate_delay_s=31.5e-9,
                gate_width_s=40e-9, hold_off_s=100e-9
            )  # fmt: skip
            self.expected_hz = rig.bench.count_rate_hz(0)

    def all(self, kind):
        return [event for event in self.events if isinstance(event, kind)]


def test_the_rate_shown_is_that_of_the_bench():
    found = Aligned()
    assert found.error is None
    levels = found.levels
    # five standard deviations of the photons that were counted: by chance once in two million
    five_sigma_hz = 5 * np.sqrt(levels.photons) / levels.live_time_s
    assert levels.mean_hz == pytest.approx(found.expected_hz, abs=five_sigma_hz)
    assert levels.photons > 10_000
    assert levels.now_hz == pytest.approx(found.expected_hz, abs=5 * np.sqrt(levels.now_hz / 0.05))
    assert levels.best_hz >= levels.now_hz
    assert levels.sync_hz == 10e6
    assert levels.dark_hz is None  # the gate opens with the laser's pulses: before them nothing is counted
    assert levels.live_time_s == pytest.approx(2.0, abs=0.2)
    assert (found.light.emitting, found.light.triggered) == (False, False)
    assert "the requested time is over" in found.all(Ended)[0].reason


def test_a_circle_is_lit_spot_by_spot_and_summed_over_a_lap():
    spots = circle(0.1, 0.2, 0.3)
    found = Aligned(spots)
    visited = [event.step.spot_m for event in found.all(StepDone)]
    assert visited[: 2 * len(spots)] == [*spots, *spots]
    assert np.hypot(*(np.array(spots)[:, :2] - (0.1, 0.2)).T) == pytest.approx(0.3)
    histogram = found.levels.histogram
    assert histogram.live_time_s == pytest.approx(24 * 0.05)  # two laps, since one is less than a second
    assert found.light.emitting is False


def test_a_device_that_fails_in_the_middle_leaves_all_dark():
    found = Aligned(after=5, do=lambda rig: setattr(rig.harp.connection, "connected", False))
    assert isinstance(found.error, DeviceError)
    assert "resume" not in str(found.error)
    assert (found.light.emitting, found.light.sensitive) == (False, False)
    assert [event.on for event in found.all(LightChanged)] == [True, False]


def test_a_hand_in_the_beam_ends_nothing_and_is_seen():
    found = Aligned(after=20, longest_s=4.0, do=lambda rig: rig.bench.change_light(blocked=True))
    assert found.error is None
    assert found.levels.of_best < 0.05
    assert min(found.levels.minute_hz) < 0.05 * found.levels.best_hz


def brighten(rig):
    rig.bench.change_light(lamp_hz=2e6)  # somebody switches on a lamp


def test_too_much_light_ends_it_as_it_ends_a_scan():
    config = tiny_config({"detector": {"kind": "mpd", "max_count_rate": "600kHz"}, "delayer": {}})
    found = Aligned(after=20, longest_s=4.0, do=brighten, config=config)
    assert isinstance(found.error, DoubtError)
    assert "too much light" in str(found.error)
    assert len(found.all(StepDone)) < 40
    assert (found.light.emitting, found.light.sensitive) == (False, False)


def counted(levels, rates_hz, live_s=0.1):
    """Give levels exposures of these rates, in two channels; the second counts three times as much."""
    levels.names = ("left", "right")
    levels(Ready(0, SimpleNamespace(sync_hz=1e7), (), {}, 300.0))
    for index, rate_hz in enumerate(rates_hz):
        counts = np.full((2, 4), rate_hz * live_s / 16, np.uint32) * np.array([[1], [3]], np.uint32)
        exposure = SimpleNamespace(counts=counts, live_time_s=live_s)
        levels(StepDone(Step(index, SPOT, live_s, 0, False), exposure))


def test_levels_are_held_against_the_best_and_say_where_they_go():
    levels = Levels(1)
    counted(levels, [160e3] * 15 + [320e3] * 3)
    assert levels.trend == 1
    assert (levels.now_hz, levels.best_hz) == pytest.approx((320e3, 320e3))
    counted(levels, [320e3] * 15)
    assert levels.trend == 0
    counted(levels, [240e3] * 3)
    assert levels.trend == -1
    assert levels.of_best == pytest.approx(0.75)
    assert levels.strongest == ("right", pytest.approx(180e3))
    assert levels.of_pulses == pytest.approx(0.018)
    assert levels.dark_hz == 300.0


def test_the_peak_of_a_histogram_and_its_background():
    """A Gaussian of 70 ps on 2 photons a bin: the peak within a bin as put together, the width in a tenth."""
    at_s = 28e-9 + (np.arange(12000) + 0.5) * 4e-12
    shape = 500 * np.exp(-4 * np.log(2) * ((at_s - 40e-9) / 70e-12) ** 2)
    counts = np.random.default_rng(1).poisson(2 + shape)
    histogram = Histogram(counts, 1.0, 4e-12, 28e-9)
    peak = histogram.peak(70e-12)
    assert peak.time_s == pytest.approx(40e-9, abs=20e-12)
    assert peak.width_s == pytest.approx(70e-12, rel=0.1)
    # the darkest 4 of 16 parts of 10 000 bins in 40 ns are low by chance, by about 1.3 sigma of a part: 4 %
    assert histogram.background_hz((31.5e-9, 71.5e-9)) == pytest.approx(20_000, rel=0.06)
    flat = Histogram(np.random.default_rng(1).poisson(2, 12000), 1.0, 4e-12, 28e-9)
    assert flat.peak(70e-12) is None


def test_what_cannot_be_is_refused():
    with pytest.raises(UsageError, match="radius must be above 0"):
        circle(0.0, 0.0, 0.0)
    with pytest.raises(UsageError, match="exposure must be above 0"):
        lap((SPOT,), 0.0)
    with pytest.raises(UsageError, match="above 0 with --for"):
        laps(lap((SPOT,), 0.1), 0.0)
    with pytest.raises(UsageError, match="at most at this exposure"):
        laps(lap((SPOT,), 1e-3), 1e6)


def test_options_that_are_wrong_light_nothing(rig):
    for arguments, code, told in (
        (("--at", "3m,0m"), 4, "this position needs"),
        (("--circle", "0m,0m,2m"), 4, "the list of 12 positions needs"),
        (("--at", "3m"), 2, "--at 30cm,-10cm"),
        (("--at", "1m,0m", "--circle", "0m,0m,1m"), 2, "give one of them"),
        (("--at", "30,10"), 2, "has no unit"),
    ):
        refused = rig("align", *arguments, "--json")
        assert refused.code == code
        assert told in json.loads(refused.out)["error"]
        assert "LASER ON" not in refused.err


def test_the_command_ends_in_the_dark_with_one_document(rig):
    done = rig("align", "--at", "30cm,-10cm", "--exposure", "50ms", "--for", "1.2s", "--json")
    assert done.code == 0, done.err
    said = json.loads(done.out)
    assert said["spots_m"] == [[0.3, -0.1, 0.0]]
    assert said["laser"]["emitting"] is False
    assert said["highest_hz"] >= said["last_hz"] > 0
    assert said["channels_hz"].keys() == {"spad"}
    assert "LASER ON since" in done.err
    assert "laser dark, read back" in done.err
    assert "% of the best" in done.err
    assert "\x1b" not in done.err


def wait_for(happened):
    deadline_s = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals and signals are POSIX")
def test_ctrl_c_is_the_usual_end_at_a_real_wire(tmp_path):
    with served(tmp_path) as bench:
        options = ("--config", bench.config, "--at", "30cm,-10cm", "--exposure", "50ms", "--yes")
        with subprocess.Popen(
            rig_command("align", *options), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as lit:
            wait_for(lambda: bench.values("laser emission") == ["1"])
            asked_rad = RigState(load(bench.config)).pointing.angles_rad(np.array(SPOT))
            aimed = [float(one) for one in bench.values("galvo mirror")[-1].split()]
            assert aimed == pytest.approx(asked_rad.tolist(), abs=1e-5)  # the mirror's own step of angle
            for line in lit.stderr:
                if "% of the best" in line:
                    break
            lit.send_signal(signal.SIGINT)
            wait_for(lambda: bench.values("laser emission")[-1] == "0")
            assert "aligned at x = 30 cm, y = -10 cm" in lit.stdout.read()
            assert lit.wait(PATIENCE_S) == 0
            assert "Ended as asked: stopped by the operator" in lit.stderr.read()
        assert bench.values("detector bias")[-1] == "0"


def test_an_exposure_that_was_cut_counts():
    """Who ends a long exposure, perhaps the only one, sees what it gave."""
    levels, counts = Levels(1), np.full((1, 8), 25, np.uint32)
    levels.names = ("one",)
    levels(StepCut(Step(0, SPOT, 10.0, 0, True), SimpleNamespace(counts=counts, live_time_s=2.0)))
    assert (levels.photons, levels.live_time_s, levels.now_hz, levels.best_hz) == (200, 2.0, 100.0, 100.0)
