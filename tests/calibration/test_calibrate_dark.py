"""Dark counts, ambient light and afterpulses: found within their errors; bad data is refused."""

import json

import numpy as np
import pytest

from rig.acquire.acquisition import Watch
from rig.calibrate.counting.afterpulses import Record, fitted
from rig.calibrate.counting.dark import DarkRoutine
from rig.calibrate.run import measured
from rig.commands.operator import ConsoleOperator
from rig.errors import CalibrationError
from rig.model.state import RigState
from support.calibration_files import config_with, write_counts
from support.drawn import line, panel

PERIOD_S, WIDTH_S = 500e-9, 256e-12
BINS = 1954


def drawn_record(rng, *, pulses, primaries, steady, p, decay_s, hold_s):
    """Light just after each pulse, steady light, carriers and hold-off, drawn one by one in absolute time."""
    light = rng.integers(0, pulses, primaries) * PERIOD_S + 30e-9 + rng.exponential(2e-9, primaries)
    fresh = np.concatenate([light, rng.uniform(0, pulses * PERIOD_S, steady)])
    times = fresh
    while len(fresh):  # carriers of carriers
        fresh = fresh[rng.random(len(fresh)) < p]
        waits = rng.exponential(decay_s, len(fresh))
        fresh = fresh[waits >= hold_s] + waits[waits >= hold_s]
        times = np.append(times, fresh)
    times.sort()
    while True:  # what comes within a hold-off of a detection is not detected, and holds off nothing
        close = np.append(False, np.diff(times) < hold_s)
        if not close.any():
            break
        times = times[~(close & ~np.append(False, close[:-1]))]
    counts, _ = np.histogram(times % PERIOD_S, np.arange(BINS + 1) * WIDTH_S)
    return Record("drawn", counts.astype(float), WIDTH_S, PERIOD_S, pulses, hold_s)


def test_afterpulses_are_found_within_their_errors():
    """Strong afterpulses, so that few counts tell.

    20 pulls have a mean within 3/sqrt(20) of 0 and a spread within 3/sqrt(40) of 1.
    """
    pulls = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        records = [
            drawn_record(
                rng, pulses=2_000_000, primaries=40_000, steady=10_000, p=0.2, decay_s=40e-9, hold_s=hold_s
            )
            for hold_s in (90e-9, 130e-9)
        ]
        got = fitted(records)
        pulls.append(
            [
                (got.probability - 0.2) / got.probability_error,
                (got.decay_s - 40e-9) / got.decay_error_s,
                got.chi2_per_bin,
            ]
        )
    pulls = np.array(pulls)
    assert np.abs(pulls[:, :2].mean(axis=0)).max() < 3 / np.sqrt(20)
    assert np.abs(pulls[:, :2].std(axis=0, ddof=1) - 1).max() < 3 / np.sqrt(40)
    assert pulls[:, 2].mean() == pytest.approx(1, abs=0.03)


def test_no_afterpulses_are_none():
    record = drawn_record(
        np.random.default_rng(0),
        pulses=10**6,
        primaries=50_000,
        steady=20_000,
        p=0.0,
        decay_s=1e-9,
        hold_s=90e-9,
    )
    got = fitted([record])
    assert not got.detected
    assert got.probability == 0
    assert got.outlasting(100e-9) == 0
    assert 0 < got.probability_error < 0.02


def test_the_instruments_longer_dead_time_is_noticed():
    """Counts that fail between hold-off and dead time do not follow the model."""
    record = drawn_record(
        np.random.default_rng(1),
        pulses=10**7,
        primaries=400_000,
        steady=20_000,
        p=0.2,
        decay_s=40e-9,
        hold_s=130e-9,
    )
    with pytest.raises(CalibrationError, match="dead time of the timing instrument"):
        fitted([Record("short", record.counts, WIDTH_S, PERIOD_S, record.pulses, 60e-9)])


def test_the_simulated_rig_is_measured(tmp_path):
    """Short exposures; all four within four of their standard errors."""
    config = config_with(tmp_path)
    routine = DarkRoutine(dark_s=60, ambient_s=20, afterpulse_s=15, hold_offs_s=(90e-9, 120e-9))
    files = measured(routine, config, ConsoleOperator(), tmp_path, Watch())
    got = routine.fit(files, RigState(config))
    assert abs(got.dark_hz - 10) < 4 * got.dark_error_hz < 2
    assert abs(got.ambient_hz - 500) < 4 * got.ambient_error_hz < 24
    assert abs(got.afterpulse_probability - 0.02) < 4 * got.afterpulse_probability_error
    assert abs(got.afterpulse_decay_s - 40e-9) < 4 * got.afterpulse_decay_error_s < 20e-9
    figure = routine.figure(files, got)
    rates = panel(figure, "counts a second")
    for name, hz in (("lens covered", 10), ("uncovered", 510)):
        # a tenth of a minute at 10 Hz has 60 counts, so the mean of all is known to 5 %; four of these
        assert line(rates, name)[:, 1].mean() == pytest.approx(hz, rel=0.2)
    outlasting = panel(figure, "afterpulses a detection (%)")
    assert outlasting.get_xlabel() == "hold-off h (ns)"
    (bars,) = outlasting.containers
    np.testing.assert_allclose(bars.lines[0].get_xydata().T, [[90, 120], 100 * np.array(got.after_hold_off)])
    hold_ns, curve = line(outlasting, "p exp(-h / tau)").T
    due = got.afterpulse_probability * np.exp(-1e-9 * hold_ns / got.afterpulse_decay_s)
    np.testing.assert_allclose(curve, 100 * due)
    for hold in ("90 ns", "120 ns"):
        assert line(panel(figure, "counts a bin"), f"hold-off {hold}")[:, 1].max() > 0
    for outlasting, error, hold_s in zip(
        got.after_hold_off, got.after_hold_off_error, got.hold_off_s, strict=True
    ):
        assert abs(outlasting - 0.02 * np.exp(-hold_s / 40e-9)) < 5 * error


# Bad data


def setup_of(tmp_path):
    config = DarkRoutine().setup(config_with(tmp_path))
    harp = config.tcspc.model_copy(update={"bin_width_s": WIDTH_S, "bins": BINS})
    return config.model_copy(update={"tcspc": harp})


def files_of(tmp_path, config, dark_hz=10.0, spoil=None, **writing):
    """A sound set of ten seconds, but for what is done to the first file."""
    rng = np.random.default_rng(3)
    files = []
    for name, hz in (("covered", dark_hz), ("uncovered", 510.0)):
        counts = rng.poisson(np.broadcast_to(hz / BINS, (10, BINS)))
        if spoil and name == "covered":
            counts = spoil(counts)
        files.append(write_counts(tmp_path / f"{name}.h5", counts, config, **writing))
    record = drawn_record(
        rng, pulses=2 * 10**6, primaries=40_000, steady=500, p=0.02, decay_s=40e-9, hold_s=90e-9
    )
    held = config.model_copy(update={"detector": config.detector.model_copy(update={"hold_off_s": 90e-9})})
    files.append(write_counts(tmp_path / "pulsed.h5", record.counts, held))
    return files


def a_light_goes_on(counts):
    counts = counts.copy()
    counts[7, ::20] += 1
    return counts


def the_beam_is_not_blocked(counts):
    counts = counts.copy()
    counts[:, 110:120] += 1
    return counts


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ({"spoil": a_light_goes_on}, "part 8 of 10 .* a light went on or off"),
        ({"spoil": the_beam_is_not_blocked}, "synchronous with the laser.*Block the beam"),
        ({"spoil": lambda counts: counts * 0}, "0 counts, but 50 are needed"),
        ({"spoil": lambda counts: counts * 0 + 4000}, "saturated"),
        ({"status": "interrupted"}, "not complete"),
        ({"warnings": ["The sync was lost, so photons are missing: check."]}, "sync was lost"),
        ({"live_s": 0.3}, "ended early"),
    ],
)
def test_bad_data_is_refused(tmp_path, how, reason):
    config = setup_of(tmp_path)
    files = files_of(tmp_path, config, **how)
    with pytest.raises(CalibrationError, match=reason):
        DarkRoutine().fit(files, RigState(config))


def test_a_cover_that_changes_nothing_is_refused(tmp_path):
    config = setup_of(tmp_path)
    files = files_of(tmp_path, config, dark_hz=510.0)
    with pytest.raises(CalibrationError, match="covering the lens makes no difference"):
        DarkRoutine().fit(files, RigState(config))


def test_files_of_another_measurement_are_refused(tmp_path):
    config = setup_of(tmp_path)
    files = files_of(tmp_path, config)
    with pytest.raises(CalibrationError, match="the first must be with the lens covered"):
        DarkRoutine().fit(files[:2], RigState(config))
    with pytest.raises(CalibrationError, match="no light of the laser is seen"):
        DarkRoutine().fit([*files[:2], files[1]], RigState(config))
    gated = config.model_copy(update={"detector": config.detector.model_copy(update={"gated": True})})
    through = write_counts(tmp_path / "gated.h5", np.ones((10, BINS)), gated)
    with pytest.raises(CalibrationError, match="through the gate"):
        DarkRoutine().fit([through, *files[1:]], RigState(config))
    scans_bins = config_with(tmp_path, detector={"gated": False})
    part = write_counts(tmp_path / "part.h5", np.ones((10, 15_000)), scans_bins)
    with pytest.raises(CalibrationError, match="not the whole time"):
        DarkRoutine().fit([part, *files[1:]], RigState(config))


def test_the_command_fits_recorded_data_and_stores_nothing_bad(tmp_path, rig):
    config = setup_of(tmp_path)
    good = files_of(tmp_path, config)
    given = [word for file in good for word in ("--from", file)]
    done = rig("calibrate", "dark", "--json", *given)
    assert done.code == 0, done.err
    told = json.loads(done.out)
    assert told["calibration"]["dark_hz"] == pytest.approx(10, abs=4)
    assert len(list((tmp_path / "calibrations").glob("dark-*"))) == 2  # the result and its picture
    for file in (tmp_path / "calibrations").glob("*"):
        file.unlink()
    done = rig("calibrate", "dark", "--from", good[1], "--from", good[0], "--from", good[2])
    assert done.code == 5
    assert "not in the order covered, uncovered" in done.err
    assert not list((tmp_path / "calibrations").glob("*"))
