"""What is known of a scan that runs: a function of what was told, and of nothing else."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rig.acquire.events import Ended, LightChanged, Noticed, Outcome, Phase, PhaseChanged, Ready
from rig.files.description import ScanDescription
from rig.live import state as live_state
from rig.live.messages import BlockBuilder, Gap
from rig.live.state import LiveState, RateHistory, Subject
from rig.model.config import built_in
from rig.model.photons import TaggedExposure
from rig.model.plan import ScanPlan
from rig.model.state import RigState

PLAN = ScanPlan.grid(built_in(), columns=10, rows=4, spacing_m=0.1, skip_m=0.0)
BINS, WIDTH_S = 3000, 16e-12
STATE = RigState.resolve(built_in())


def described(channels=1):
    one = STATE.channels[0]
    spots = [replace(one, name=f"c{n}", input=n, spot_m=(0.01 * n, 0.0, 0.0)) for n in range(channels)]
    return ScanDescription(
        laser_m=PLAN.spots_m,
        detector_m=np.array([[spot.spot_m for spot in spots]]),
        bins=BINS,
        bin_width_s=WIDTH_S,
        first_bin_s=0.0,
        delays=STATE.delays,
        channels=tuple(spots),
        plan=PLAN,
        state=STATE,
        gate_start_s=10e-9,
        gate_stop_s=40e-9,
    )


def histograms(channels=1):
    return np.random.default_rng(3).poisson(0.02, (len(PLAN), channels, BINS)).astype(np.uint32)


def exposure(counts, live_time_s=0.01):
    return SimpleNamespace(counts=counts, photons=int(counts.sum()), live_time_s=live_time_s, warnings=())


def block(counts, first, stop, when_s=0.0):
    builder = BlockBuilder()
    for step in range(first, stop):
        builder.add(step, exposure(counts[step]))
    return builder.take(when_s)


@pytest.mark.parametrize("channels", [1, 3])
def test_a_block_holds_the_photons_of_histograms_and_of_tagged_exposures(channels):
    counts = histograms(channels)
    counts[2, 0, 7] = 1000
    dense = block(counts, 0, 5)
    tagged = BlockBuilder()
    for step in range(5):
        rows, bins = np.nonzero(counts[step])
        times = counts[step][rows, bins]
        photons = np.repeat(bins, times).astype(np.uint16)
        tagged.add(step, TaggedExposure(photons, counts[step].sum(axis=1, dtype=np.int64), BINS, 0.01))
    for made in (dense, tagged.take(0.0)):
        row = np.repeat(np.arange(5 * channels), np.diff(made.offset))
        found = np.zeros((5 * channels, BINS), np.uint32)
        np.add.at(found, (row, made.photon_bins), 1)
        np.testing.assert_array_equal(found.reshape(5, channels, BINS), counts[:5])
        assert made.photon_bins.dtype == np.uint16


@pytest.mark.parametrize("channels", [1, 3])
def test_the_state_is_what_the_events_say(channels):
    description, counts = described(channels), histograms(channels)
    subject = Subject.of("a.h5", description)
    state = LiveState(subject)
    light = LightChanged(True, "2026-11-27T15:00:00+00:00")
    rates = SimpleNamespace(sync_hz=1e7, input_hz=2e5)
    for event in (PhaseChanged(Phase.EXPOSING), light, Ready(0, rates, ("The input rate is low.",), {})):
        state(event)
    state(block(counts, 0, 10, 1000.0))
    state(block(counts, 10, 25, 1000.3))
    state(Noticed("the mirror was steered a second time", 12, 12))
    seen = state.seen()
    assert (seen.phase, seen.light, seen.rates, seen.measured) == ("exposing", light, rates, 25)
    assert [(one.sentence, one.first, one.last) for one in seen.warnings] == [
        ("The input rate is low.", 0, 0), ("the mirror was steered a second time", 12, 12)
    ]  # fmt: skip
    np.testing.assert_array_equal(seen.photons[:25], counts[:25].sum(axis=(1, 2)))
    assert np.isnan(seen.photons[25:]).all()
    # each photon in its rectified time, from the path delays themselves
    spots_m = description.detector_m
    delay_s = description.delays.delay_s(PLAN.spots_m[:, None], spots_m) + STATE.channels[0].delay_s
    step, channel, bins = np.nonzero(counts[:25])
    times_s = (bins + 0.5) * WIDTH_S - delay_s[step, channel]
    wanted, _ = np.histogram(times_s, seen.histogram_edges_s, weights=counts[step, channel, bins])
    assert np.abs(seen.histogram - wanted).sum() <= 2e-3 * wanted.sum()  # on an edge by rounding
    assert seen.histogram.sum() == counts[:25].sum()
    # 25 steps from 0.1 s (ten exposures) before 1000 to 1000.3
    assert seen.left_s == pytest.approx(0.4 / 25 * 15)
    assert seen.ends_s == pytest.approx(1000.3 + seen.left_s)
    assert (seen.ended, seen.lost, seen.picture) == (None, False, None)


def test_the_gate_is_in_rectified_time():
    description = described()
    (opens, closes) = Subject.of("a.h5", description).gate_s
    delay_s = description.delays.delay_s(PLAN.spots_m[:, None], description.detector_m)
    delay_s = delay_s + STATE.channels[0].delay_s
    assert opens == pytest.approx((10e-9 - delay_s.max(), 10e-9 - delay_s.min()))
    assert closes == pytest.approx((40e-9 - delay_s.max(), 40e-9 - delay_s.min()))


def test_steps_that_were_left_out_are_known_to_be_measured_until_they_come():
    counts, state = histograms(), LiveState(Subject.of("a.h5", described()))
    state(Gap(0, 8))
    state(block(counts, 8, 12, 5.0))
    assert state.seen().measured == 12
    np.testing.assert_array_equal(np.flatnonzero(state.missing), np.arange(8))
    before = state.seen().left_s
    state(block(counts, 0, 8, float("nan")))  # read from the file: it says nothing of the pace
    seen = state.seen()
    assert not state.missing.any()
    assert (seen.measured, seen.left_s) == (12, before)
    assert seen.histogram.sum() == counts[:12].sum()


def test_steps_that_were_taken_back_are_empty_again():
    counts, state = histograms(), LiveState(Subject.of("a.h5", described()))
    state(block(counts, 0, 20, 5.0))
    state(Ended(Outcome.FAILED, 10, "the laser went dark"))
    seen = state.seen()
    assert seen.measured == 10
    assert seen.ends_s is None
    assert np.isnan(seen.photons[10:]).all()
    state.lose()
    assert not state.seen().lost  # it said how it ended


def test_a_program_that_is_gone_without_a_word_is_known():
    state = LiveState(Subject.of("a.h5", described()))
    state.lose()
    assert state.seen().lost


def test_warnings_and_rates_take_bounded_memory():
    state, history = LiveState(Subject.of("a.h5", described())), RateHistory()
    for number in range(3 * live_state.WARNINGS):
        state(Noticed(f"warning {number}", number, number))
        state(Noticed("of every line", number, number))
    warnings = state.seen().warnings
    assert len(warnings) == live_state.WARNINGS
    assert (warnings[-1].first, warnings[-1].last) == (0, 3 * live_state.WARNINGS - 1)
    for second in range(100_000):
        history.add(float(second), 300, 0.1)
    moments_s, photons_per_s = history.curve()
    assert len(moments_s) <= live_state.MOMENTS
    assert moments_s[-1] == pytest.approx(100_000, rel=0.01)
    np.testing.assert_allclose(photons_per_s, 3000)


def test_a_moment_with_few_positions_is_no_dip_of_the_rate():
    history = RateHistory()
    for second in range(10):
        history.add(float(second), 300 if second != 4 else 1, 0.1 if second != 4 else 0.001)
    moments_s, photons_per_s = history.curve()
    assert len(moments_s) == 9
    np.testing.assert_allclose(photons_per_s, 3000)
    assert RateHistory().curve()[0].shape == (0,)
