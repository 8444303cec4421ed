"""A scan that ends by itself, and goes on when it is asked to."""

import json
import time
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from recon import defaults
from recon.capture import ArrayHistograms, Capture
from rig.acquire.acquisition import Watch, acquire
from rig.acquire.events import Ended, LineDone, Outcome, StepDone
from rig.errors import UsageError
from rig.files import ScanFile
from rig.files.description import ScanDescription
from rig.image.until import Rule, Until, expected
from rig.model.config import built_in
from rig.model.plan import ScanPlan
from rig.model.state import RigState

SMALL = ("--grid", "24x16", "--spacing", "7cm", "--exposure", "10ms", "--order", "progressive")


@pytest.fixture
def scanned(rig, tmp_path):
    assert rig("scan", *SMALL, "--out", "a.h5").code == 0
    with ScanFile(tmp_path / "a.h5") as scan:
        yield scan


def description(scan):
    return ScanDescription(
        laser_m=scan.laser_m,
        detector_m=scan.detector_m,
        bins=scan.bins,
        bin_width_s=scan.bin_width_s,
        first_bin_s=scan.first_bin_s,
        delays=scan.delays,
        channels=scan.channels,
        plan=scan.plan,
        fade_from_s=scan.fade_from_s,
        instrument_response_s=scan.instrument_response_s,
    )


def play(scan, until, first=0):
    """Tell a consumer of a scan from a step on; return its reason as soon as it has one."""
    until.begun(description(scan))
    for step in scan.plan.steps(first):
        counts = scan.counts(range(step.index, step.index + 1))[0]
        until(StepDone(step, SimpleNamespace(counts=counts, live_time_s=0.01)))
        if step.ends_line:
            until(LineDone(step.index + 1))
    give_up_s = time.monotonic() + 120  # pictures of 384 positions take seconds, and compiling a few more
    while not until.reason() and not until.trouble and time.monotonic() < give_up_s:
        time.sleep(0.05)
    reason = until.reason()
    until(Ended(Outcome.COMPLETE, len(scan.plan), ""))
    assert not until.trouble
    return reason


@pytest.mark.parametrize("rule", ["likeness 0.5", "contrast 3"])
def test_pictures_end_a_scan_at_a_round(scanned, rule):
    kind, least = rule.split()
    reason = play(scanned, Until(Rule.from_text(rule, scanned.plan)))
    words = reason.split()
    assert words[0] == kind
    assert float(words[1]) >= float(least)
    assert int(words[-2].replace(",", "")) in scanned.plan.passes[0].positions.rounds


def interrupted_at(step, path):
    """The same scan, ended before a step."""
    state = RigState.resolve(built_in())
    plan = ScanPlan.grid(
        state.config, columns=24, rows=16, spacing_m=0.07, exposure_s=0.01, order="progressive"
    )
    done = 0

    def count(event):
        nonlocal done
        done += isinstance(event, StepDone)

    acquire(plan, state, path, Watch([count], lambda: done >= step))


@pytest.mark.parametrize("rule", ["likeness 0.95", "contrast 6500"])  # after the third or fourth round
def test_a_scan_that_is_taken_up_again_is_judged_as_one_that_went_on(scanned, tmp_path, rule):
    """The round that is complete in the file is the one before the first new one."""
    whole = Until(Rule.from_text(rule, scanned.plan))
    play(scanned, whole)
    rounds = scanned.plan.passes[0].positions.rounds
    reached = int(whole.reason().split()[-2].replace(",", ""))
    first = rounds[rounds.index(reached) - 1] + 2
    interrupted_at(first, tmp_path / "part.h5")
    again = Until(Rule.from_text(rule, scanned.plan))
    with ScanFile(tmp_path / "part.h5") as part:
        again.take_up(part)
        assert np.flatnonzero(part.done).tolist() == list(range(first))
    assert not again.reason()
    assert play(scanned, again, first) == whole.reason()


def test_resume_ends_by_the_rules_of_scan(rig, tmp_path):
    interrupted_at(200, tmp_path / "part.h5")
    done = rig("resume", "part.h5", "--until", "contrast 1e9x")
    assert (done.code, "is not a rule" in done.err) == (2, True)
    told = json.loads(rig("resume", "part.h5", "--until", "time 1ms", "--json").out)
    assert told["status"] == "interrupted"
    assert 200 < told["positions"] < 384
    assert told["reason"].startswith("time ")
    # what the file holds may be enough: then nothing is measured, and the laser stays dark
    met = rig("resume", "part.h5", "--until", "contrast 0.001", "--json")
    assert met.code == 0, met.err
    now = json.loads(met.out)
    assert (now["positions"], now["laser"]["emitting"]) == (told["positions"], False)
    with ScanFile(tmp_path / "part.h5") as part:
        assert part.reason == now["reason"]
        assert part.reason.startswith("contrast ")
    assert "Ended as asked: contrast" in met.err
    assert rig("resume", "part.h5").code == 0


def test_what_is_expected_of_a_scan_is_what_its_file_then_says(scanned):
    foreseen, found = expected(description(scanned)), scanned.capture()
    assert np.array_equal(foreseen.laser_m, found.laser_m)
    assert np.array_equal(foreseen.detector_m, found.detector_m)
    assert np.array_equal(foreseen.first_bin_s, found.first_bin_s)


def test_time_ends_a_scan_which_goes_on_to_the_same_photons(rig, scanned, tmp_path):
    done = rig("scan", *SMALL, "--until", "time 1ms", "--out", "b.h5", "--json")
    assert done.code == 0, done.err
    told = json.loads(done.out)
    assert told["status"] == "interrupted"
    assert 0 < told["positions"] < 384
    with h5py.File(tmp_path / "b.h5") as file:
        assert file["stop"].attrs["reason"] == told["reason"]
    assert told["reason"].startswith("time ")
    assert told["reason"].endswith("of the 1 ms requested")
    assert rig("resume", "b.h5").code == 0
    with h5py.File(tmp_path / "b.h5") as ours, h5py.File(tmp_path / "a.h5") as whole:
        assert np.array_equal(ours["transients/counts"], whole["transients/counts"])


@pytest.mark.parametrize(
    "text", ["", "likeness", "likeness 1", "contrast much", "time -1s", "soon 3", "contrast nan"]
)
def test_what_is_no_rule_is_refused(text):
    with pytest.raises(UsageError):
        Rule.from_text(text, ScanPlan.grid(built_in(), order="progressive"))


def test_a_raster_has_no_pictures_to_judge():
    with pytest.raises(UsageError, match="--order progressive"):
        Rule.from_text("likeness 0.9", ScanPlan.grid(built_in()))


@pytest.mark.parametrize(
    ("complete", "part", "spacing_m"),
    [
        (3, 0, 0.04),
        (3, 0.4, 0.04),
        (4, 0, 0.04 / 2**0.5),
        (4, 0.7, 0.04 / 2**0.5),
        (5, 0.1, 0.02),
        (7, 0, 0.01),
    ],
)
def test_an_unfinished_scan_has_the_spacing_of_its_finest_complete_round(complete, part, spacing_m):
    grid = ScanPlan.grid(built_in(), order="progressive").passes[0].positions
    rounds = (*grid.rounds, grid.rounds[-1])
    done = rounds[complete - 1] + int(part * (rounds[complete] - rounds[complete - 1]))
    spots_m = grid.spots_m[:done]
    nothing = ArrayHistograms(np.zeros((done, 1), np.uint8))
    capture = Capture(nothing, 4e-12, np.zeros(1), spots_m, np.zeros((1, 3)))
    # the lattice is fitted to the positions, which are exact to rounding
    assert defaults.spacing_m(capture) == pytest.approx(spacing_m, rel=1e-6)
