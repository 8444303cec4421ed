"""Bin widths: no more is believed than counting allows, and corrected counts have counting noise alone."""

import json

import numpy as np
import pytest
from matplotlib.image import imread

from recon.capture import ArrayHistograms
from rig.acquire.acquisition import Watch
from rig.calibrate.counting.dnl import DnlRoutine
from rig.calibrate.run import measured
from rig.commands.operator import ConsoleOperator
from rig.errors import CalibrationError, DataFileError
from rig.files import ScanDescription, ScanFile, ScanWriter
from rig.image.even_bins import corrected
from rig.model.calibrations.base import Calibration, digest
from rig.model.calibrations.chosen import Calibrations
from rig.model.calibrations.store import CalibrationStore, read
from rig.model.config import built_in
from rig.model.state import RigState
from support.calibration_files import config_with, write_counts
from support.drawn import line, panel

BINS = 2000


def free_running(tmp_path, bins=BINS, **more):
    harp = {"bin_width_s": 32e-12, "bins": bins, "offset_s": 28e-9, **more}
    return config_with(tmp_path, detector={"gated": False}, tcspc=harp)


def real_widths(rng, rms, bins=BINS):
    widths = 1 + np.clip(rng.laplace(0, rms / np.sqrt(2), bins), -0.05, 0.05)
    return widths / widths.mean()


def calibrated(tmp_path, counts, config=None, name="lamp.h5", **writing) -> Calibration:
    config = config or free_running(tmp_path)
    writing = {"exposure_s": 1000.0, **writing}
    path = write_counts(tmp_path / name, counts, config, **writing)
    return DnlRoutine().fit([path], RigState(config))


@pytest.mark.parametrize("rms", [0.0, 0.002, 0.01])
def test_corrected_counts_have_the_noise_of_both_measurements_and_no_more(tmp_path, rms):
    """20 instruments, independent uniform light.

    chi2 per bin against the variance due, 1/N2 + S N/(S + N), is 1 within four times sqrt(2/bins/20),
    doubled since S is estimated. Where the non-linearity is plain, most of it is taken away; where
    there is none, it does no harm: what it adds is the noise of S alone, below 1 %.
    """
    raw, left, due = [], [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        widths = real_widths(rng, rms)
        found = calibrated(tmp_path, rng.poisson(50_000 * widths), name=f"{seed}.h5")
        counts = rng.poisson(50_000 * widths)
        histograms = corrected(ArrayHistograms(counts[None]), found, bin_width_s=32e-12, first_bin_s=28e-9)
        (_, flat), *_ = histograms.blocks()
        mean = counts.mean()
        believed = found.nonlinearity**2 * found.noise**2 / (found.nonlinearity**2 + found.noise**2)
        raw.append(counts.var() / mean)
        left.append(flat.astype(float).var() / mean)
        due.append(left[-1] / (1 + believed * mean))
        assert found.nonlinearity <= found.nonlinearity_at_most
        if rms:
            assert found.nonlinearity == pytest.approx(rms, rel=0.5)
    assert np.mean(due) == pytest.approx(1, abs=8 * np.sqrt(2 / BINS / 20))
    assert np.mean(left) < np.mean(raw) + 0.01
    if rms == 0.01:
        assert np.mean(raw) > 5
        assert np.mean(left) < 2


def test_the_simulated_rig_is_measured_and_the_command_stores_it(tmp_path, rig):
    config = tmp_path / "rig.toml"
    config.write_text(
        'hydraharp = { bin_width = "256ps", bins = 290, offset = "28ns" }\n'
        "[simulation.faults]\nnonlinearity = 0.0199\n"
    )
    done = rig("calibrate", "dnl", "--config", config, "--exposure", "1s", "--json")
    assert done.code == 0, done.err
    told = json.loads(done.out)["calibration"]
    # cut at 2 % the pattern has 1.28 % rms; 2500 counts a bin tell it to 0.2 %
    assert told["nonlinearity"] == pytest.approx(0.0128, abs=0.006)
    assert told["kept"] > 0.05
    stored = next((tmp_path / "calibrations").glob("dnl-*.json"))
    found = read(stored)
    assert found.widths.shape == (290,)
    # the sync period ends 72 ns after the first bin's edge: 281 whole bins, of which three may reach over it
    assert [width is None for width in found.measured] == [False] * 278 + [True] * 12
    assert (found.widths[278:] == 1).all()
    assert imread(stored.with_suffix(".png")).shape[:2] == (750, 1200)
    figure = DnlRoutine().figure([], found)
    widths = panel(figure, "width, deviation from mean (%)")
    assert widths.get_xlabel() == "time after the sync pulse (ns)"
    believed = line(widths, "kept")
    np.testing.assert_allclose(believed[:, 1], 100 * (found.widths[:278] - 1))
    np.testing.assert_allclose(np.diff(believed[:, 0]), 1e9 * found.bin_width_s)
    counted = np.array(found.measured[:278], float)
    np.testing.assert_allclose(line(widths, "as counted")[:278, 1], 100 * (counted - 1))
    (bars,) = panel(figure, "bins").containers
    assert sum(bar.get_height() for bar in bars) == 278


def test_steady_light_fills_the_bins_evenly_whatever_the_detector_does(tmp_path):
    """With hold-off, afterpulses and dead time the counts still scatter as independent ones.

    chi2 per bin of 1000 bins is 1 within four times sqrt(2/1000).
    """
    config = free_running(tmp_path, bins=1000, bin_width_s=64e-12)
    file = measured(DnlRoutine(exposure_s=1.0), config, ConsoleOperator(), tmp_path, Watch())[0]
    with ScanFile(file) as scan:
        counts = sum(block.sum(axis=0) for _, block in scan.capture().histograms.blocks()).astype(float)
    assert counts.var() / counts.mean() == pytest.approx(1, abs=4 * np.sqrt(2 / 1000))


def test_blocks_and_slices_are_divided_by_their_own_widths(tmp_path):
    rng = np.random.default_rng(5)
    found = calibrated(tmp_path, rng.poisson(1e6 * real_widths(rng, 0.01)))
    counts = rng.poisson(3, (7, BINS)).astype("u4")
    histograms = corrected(ArrayHistograms(counts, 3), found, bin_width_s=32e-12, first_bin_s=28e-9)
    assert histograms.shape == counts.shape
    for bins in (slice(None), slice(100, 300)):
        blocks = list(histograms.blocks(bins))
        assert [where.start for where, _ in blocks] == [0, 3, 6]
        got = np.concatenate([block for _, block in blocks])
        assert got.dtype == np.float32
        np.testing.assert_allclose(got, (counts / found.widths)[:, bins], rtol=1e-6)


@pytest.mark.parametrize(
    "other", [{"bin_width_s": 16e-12}, {"first_bin_s": 29e-9}, {"bins": BINS - 1}], ids=str
)
def test_widths_of_other_bins_are_refused(tmp_path, other):
    found = calibrated(tmp_path, np.full(BINS, 10_000))
    asked = {"bin_width_s": 32e-12, "first_bin_s": 28e-9, "bins": BINS, **other}
    histograms = ArrayHistograms(np.zeros((2, asked.pop("bins"))))
    with pytest.raises(CalibrationError, match="are those of 2000 bins of 32 ps from 28 ns"):
        corrected(histograms, found, **asked)


# Bad data


def lamp(rng=None, counts=10_000):
    return (rng or np.random.default_rng(7)).poisson(counts, BINS)


def part_lit(counts):
    return np.where(np.arange(BINS) < 1500, counts, 0)


def pulsed(counts):
    counts = counts.copy()
    counts[700:800] += 300
    return counts


@pytest.mark.parametrize(
    ("spoil", "writing", "reason"),
    [
        (lambda counts: counts // 200, {}, "too few"),
        (part_lit, {}, "500 bins between 1500 and 1999 are empty"),
        (pulsed, {}, "the light follows the laser"),
        (lambda counts: counts, {"exposure_s": 1.0}, "saturated"),
        (lambda counts: counts, {"status": "interrupted"}, "not complete"),
        (lambda counts: counts, {"warnings": ["A bin of the histogram is full: expose shorter."]}, "is full"),
    ],
)
def test_bad_data_is_refused(tmp_path, spoil, writing, reason):
    with pytest.raises(CalibrationError, match=reason):
        calibrated(tmp_path, spoil(lamp()), **writing)


def test_counts_through_the_gate_are_refused(tmp_path):
    gated = config_with(tmp_path, tcspc={"bin_width_s": 32e-12, "bins": BINS})
    with pytest.raises(CalibrationError, match="through the gate"):
        calibrated(tmp_path, lamp(), gated)


def test_files_are_added_only_where_their_bins_agree(tmp_path):
    rng = np.random.default_rng(9)
    config = free_running(tmp_path)
    files = [write_counts(tmp_path / f"{i}.h5", lamp(rng), config, exposure_s=1000.0) for i in range(2)]
    found = DnlRoutine().fit(files, RigState(config))
    assert found.counts_per_bin == pytest.approx(20_000, rel=1e-3)
    assert len(found.measured_from) == 2
    later = free_running(tmp_path, offset_s=29e-9)
    other = write_counts(tmp_path / "later.h5", lamp(rng), later, exposure_s=1000.0)
    with pytest.raises(CalibrationError, match="other bins"):
        DnlRoutine().fit([*files, other], RigState(config))


def test_widths_are_kept_beside_the_text_and_in_scans_and_come_back_whole(tmp_path):
    found = calibrated(tmp_path, lamp())
    assert len(found.document()) < 3000  # thousands of widths are not in it
    store = CalibrationStore(tmp_path / "store")
    path = store.add(found)
    assert read(path) == found
    state = RigState(built_in(), Calibrations({"dnl": found}))
    description = ScanDescription(np.zeros((1, 3)), np.zeros((1, 3)), 5, 4e-12, 0.0, state=state)
    with ScanWriter.create(tmp_path / "scan.h5", description) as writer:
        writer.append(np.zeros(5, "u4"))
    with ScanFile(tmp_path / "scan.h5") as scan:
        assert scan.state == state


def test_widths_that_are_missing_or_others_are_noticed(tmp_path):
    found = calibrated(tmp_path, lamp())
    path = CalibrationStore(tmp_path / "store").add(found)
    beside = path.with_suffix(".npz")
    np.savez(beside, measured=np.ones(BINS))
    with pytest.raises(DataFileError, match="'measured' is missing, or differs"):
        read(path)
    beside.write_bytes(b"PK damaged")
    with pytest.raises(DataFileError, match="damaged"):
        read(path)
    beside.unlink()
    with pytest.raises(DataFileError, match="'measured' is missing"):
        read(path)


def test_widths_that_an_older_program_kept_in_the_text_are_read(tmp_path):
    found = calibrated(tmp_path, lamp())
    content = {"kind": "dnl", **found.model_dump(mode="json")}
    path = tmp_path / "dnl-20260101T000000Z.json"
    path.write_text(json.dumps({**content, "digest": digest(content)}))
    assert read(path) == found
