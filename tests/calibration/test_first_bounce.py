"""First bounces in free-running scans: found, fitted, refused."""

import numpy as np
import pytest
from scipy.integrate import quad

from rig.calibrate.raw import Raw
from rig.calibrate.timing import peaks
from rig.calibrate.timing.first_bounce import first_bounces, free_running
from rig.errors import CalibrationError
from rig.files.description import ScanDescription
from rig.files.scan import ScanFile
from rig.files.writer import ScanWriter
from rig.model.config import built_in, built_in_with
from rig.model.state import RigState

SHAPE = peaks.Emg(27.6e-12, 53e-12, 0.07)
BIN_S, BINS = 4e-12, 25_000
PULSES = 1_000_000


def drawn_s(number, rng, centre_s=30e-9):
    """Times of photons: the core, and an exponential wait for some."""
    times_s = centre_s + SHAPE.sigma_s * rng.standard_normal(number)
    late = rng.random(number) < SHAPE.tail_fraction
    return times_s + late * SHAPE.tail_s * rng.standard_exponential(number)


def histogram(times_s):
    return np.histogram(times_s, np.arange(BINS + 1) * BIN_S)[0].astype(np.uint32)


def scan_of(path, histograms, config=None):
    """A file as a free-running scan of 0.1 s a position leaves it."""
    config = free_running(config or built_in())
    angles = 0.01 * np.stack([np.arange(len(histograms)), np.zeros(len(histograms))], axis=1)
    description = ScanDescription(
        laser_m=np.pad(2.5 * angles, ((0, 0), (0, 1))),
        detector_m=np.zeros((1, 3)),
        bins=BINS,
        bin_width_s=BIN_S,
        first_bin_s=0.0,
        state=RigState(config),
        mirror_rad=angles,
    )
    with ScanWriter.create(path, description) as writer:
        for counts in histograms:
            writer.append(counts, PULSES / config.laser.repetition_hz)
        writer.close("complete")
    return ScanFile(path)


def test_the_distribution_is_the_integral_of_the_density():
    for at_s in (-40e-12, 0.0, 30e-12, 300e-12):
        area, _ = quad(lambda t: SHAPE.density(np.array(t)), -300e-12, at_s, epsabs=1e-9)
        assert area == pytest.approx(float(SHAPE.cumulative(np.array(at_s))), abs=1e-7)


def test_errors_of_the_fit_cover_the_truth():
    edges_s = np.arange(301) * BIN_S
    centre, shape = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        true_s = 400e-12 + 50e-12 * rng.random(10)
        seen = np.stack(
            [np.histogram(drawn_s(2000, rng, at_s), edges_s)[0] for at_s in true_s]
        ) + rng.poisson(0.5, (10, 300))
        found = peaks.fit(np.tile(edges_s, (10, 1)), seen.astype(float), np.ones((10, 300)))
        centre += list((found.centre_s - true_s) / found.centre_error_s)
        shape += [
            (getattr(found.shape, name) - getattr(SHAPE, name)) / getattr(found.shape_error, name)
            for name in ("sigma_s", "tail_s", "tail_fraction")
        ]
    # rms of n pulls of unit width: 1 +- 1/sqrt(2 n); 200 and 60 of them, four standard deviations
    assert np.sqrt(np.mean(np.square(centre))) == pytest.approx(1, abs=0.2)
    assert np.sqrt(np.mean(np.square(shape))) == pytest.approx(1, abs=0.37)


def test_pile_up_is_corrected_for(tmp_path):
    # one photon at most in a hold-off that is shorter than the period: the earliest wins
    rng = np.random.default_rng(1)
    config = built_in_with({"spad": {"hold_off": "30ns"}})
    light, histograms = 0.1, []  # photons a pulse: 0.095 detected
    for _ in range(4):
        pulse = rng.integers(0, PULSES, rng.poisson(light * PULSES))
        times_s = drawn_s(len(pulse), rng)
        order = np.lexsort((times_s, pulse))
        first = np.unique(pulse[order], return_index=True)[1]
        histograms.append(histogram(times_s[order][first]))
    with scan_of(tmp_path / "scan.h5", histograms, config) as scan:
        found = first_bounces(Raw(scan.passes()[0]))
    # uncorrected, the centre is early by about light sigma / sqrt(pi) = 1.6 ps, 17 of its standard errors
    assert np.abs(found.centre_s - 30e-9).max() < 4 * found.centre_error_s.max() < 0.5e-12
    assert found.counts == pytest.approx(light * PULSES, rel=4 / np.sqrt(light * PULSES))


def bad(kind, rng):
    peak = histogram(drawn_s(4000, rng))
    match kind:
        case "full":
            return np.minimum(peak, 150)
        case "saturated":
            return histogram(drawn_s(PULSES // 5, rng))
        case "no peak":
            return rng.poisson(0.01, BINS).astype(np.uint32)
        case "two strong peaks":
            return peak + histogram(drawn_s(4000, rng, 30.6e-9))
        case "cut off":
            return histogram(drawn_s(4000, rng, 0.2e-9))
    return peak


@pytest.mark.parametrize("kind", ["full", "saturated", "no peak", "two strong peaks", "cut off"])
def test_bad_peaks_are_refused_by_name_or_left_out_where_they_are_few(kind, tmp_path):
    rng = np.random.default_rng(0)
    with (
        scan_of(tmp_path / "bad.h5", [bad(kind, rng) for _ in range(4)]) as scan,
        pytest.raises(CalibrationError, match=kind),
    ):
        first_bounces(Raw(scan.passes()[0]))
    few = [bad("good", rng), bad("good", rng), bad(kind, rng), bad("good", rng)]
    with scan_of(tmp_path / "few.h5", few) as scan:
        found = first_bounces(Raw(scan.passes()[0]))
    assert list(found.index) == [0, 1, 3]
    assert kind in found.left_out[2]
    assert np.abs(found.centre_s - 30e-9).max() < 4 * found.centre_error_s.max()


def test_a_scan_through_the_gate_holds_no_first_bounces(rig, tmp_path):
    assert rig("scan", "--grid", "4x3", "--spacing", "20cm", "--exposure", "1ms", "--out", "a.h5").code == 0
    for kind in ("time-zero", "irf"):
        done = rig("calibrate", kind, "--from", "a.h5")
        assert done.code == 5
        assert "through the gate" in done.err
    assert not (tmp_path / "calibrations").exists()
