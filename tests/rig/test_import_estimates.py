"""``rig import --estimate``: file, words and picture tell estimates; what cannot be told is refused."""

import json

import h5py
import numpy as np
import pytest
import scipy.io

from rig.errors import UsageError
from rig.files import ScanFile
from rig.importers import import_scan
from support.hidden_points import histograms, wall
from support.scan_files import load

SIDE_M, BIN_S, BINS, LATE_S = 23 * 0.035, 16e-12, 600, 2e-9
POINTS_M = np.array([[0.15, 0.1, 0.6], [-0.2, 0.0, 0.75], [0.05, -0.25, 0.55], [-0.05, 0.2, 0.7]])


def _counts(detector_m, late_s=0.0, glare=0.0):
    """Photons of four points, as (576, bins); time zero is `late_s` after the record's start."""
    mean = 0.2 * histograms(POINTS_M, wall(24, 24, 0.035), detector_m, BINS, BIN_S, -late_s) + 0.005
    centres_s = (np.arange(BINS) + 0.5) * BIN_S - late_s
    mean += glare * np.exp(-((centres_s / 40e-12) ** 2) / 2)
    return np.random.default_rng(0).poisson(mean)


@pytest.fixture
def late(tmp_path):
    """A neutral file with one detector spot, 2 ns late."""
    with h5py.File(tmp_path / "late.h5", "w") as file:
        file["counts"] = _counts(np.zeros((1, 3)), LATE_S).astype("u2")
        file["laser_position_m"], file["detector_position_m"] = wall(24, 24, 0.035), np.zeros((1, 3))
        file["time_s"] = (np.arange(BINS) + 0.5) * BIN_S
        file.attrs.update({"bin_width_s": BIN_S, "time_origin": "wall"})
    return tmp_path / "late.h5"


@pytest.fixture
def cube(tmp_path):
    """A confocal file that says neither how wide its bins are nor how large its wall is."""

    def write(**how):
        laser_m = wall(24, 24, 0.035)
        rows = _counts(laser_m, **how).reshape(24, 24, BINS)  # (y, x, t)
        scipy.io.savemat(tmp_path / "cube.mat", {"sig": rows.transpose(1, 0, 2).astype(float)})
        return tmp_path / "cube.mat"

    return write


def test_time_zero_is_moved_and_told_of(late, rig):
    done = rig("import", late, "scan.h5", "--estimate", "time-origin")
    assert done.code == 0, done.err
    assert "time zero" in done.out
    assert "estimated from the sharpest image" in done.out
    with ScanFile("scan.h5") as scan:
        (estimate,) = scan.imported["estimated"]
        first_s = scan.capture().first_bin_s[0]
        assert "estimated" in str(scan)
    assert estimate["low"] <= LATE_S <= estimate["high"]
    assert first_s == pytest.approx(-estimate["value"], abs=1e-18)
    coarse = ("--wavelength", "14cm", "--voxel", "7cm", "--depth", "0.4m:0.9m:5cm")
    done = rig("recon", "scan.h5", *coarse)
    assert done.code == 0, done.err
    assert estimate["words"] in done.out
    done = rig("recon", "scan.h5", *coarse, "--image", "again.svg", "--json")
    assert json.loads(done.out)["estimated"] == [estimate["words"]]


def test_the_picture_says_that_a_value_is_an_estimate():
    from rig.files import Volume
    from rig.files.words import parameters_line

    axis_m = np.arange(2.0)
    volume = Volume(np.ones((2, 2, 2), "f4"), axis_m, axis_m, axis_m, parameters={"estimated": ["bin width"]})
    assert "estimated: bin width" in parameters_line(volume)


def test_a_bin_width_is_estimated_for_a_file_that_lacks_it(cube, tmp_path):
    source, target = cube(), tmp_path / "scan.h5"
    report = import_scan(source, target, estimate=["bin-width"], wall_size_m=SIDE_M)
    assert any("bin width" in line and "estimated" in line for line in report.assumed)
    with ScanFile(target) as scan:
        (estimate,) = scan.imported["estimated"]
        assert scan.bin_width_s == estimate["value"]
    assert estimate["low"] <= BIN_S <= estimate["high"]


def test_a_first_bounce_leaves_the_walls_size_to_the_image(cube, tmp_path):
    source, target = cube(late_s=1e-9, glare=2000.0), tmp_path / "scan.h5"
    with pytest.raises(UsageError, match="does not contain how large"):
        import_scan(source, target, bin_width_s=BIN_S)
    import_scan(source, target, estimate=["time-origin", "wall-size"], bin_width_s=BIN_S)
    with ScanFile(target) as scan:
        zero, size = scan.imported["estimated"]
    assert zero["how"] == "the first bounce"
    assert zero["low"] <= 1e-9 <= zero["high"]
    assert size["low"] <= SIDE_M <= size["high"]
    assert np.ptp(load(target)[0].laser_m[:, 0]) == pytest.approx(size["value"])


@pytest.mark.parametrize(
    ("wanted", "given", "said"),
    [
        (["depth"], {}, "only time-origin, bin-width, wall-size can be estimated"),
        (["bin-width", "wall-size"], {}, "twice as large"),
        (["time-origin", "bin-width", "wall-size"], {}, "twice as large"),
        (["time-origin", "bin-width"], {"wall_size_m": 0.8}, "equally sharp"),
        (["bin-width"], {"bin_width_s": BIN_S}, "--bin-width is given"),
        (["time-origin", "wall-size"], {"bin_width_s": BIN_S}, "only where a confocal record holds"),
    ],
)
def test_what_cannot_be_told_is_refused_in_words(cube, tmp_path, wanted, given, said):
    with pytest.raises(UsageError, match=said):
        import_scan(cube(), tmp_path / "scan.h5", estimate=wanted, **given)
    assert not (tmp_path / "scan.h5").exists()


def test_what_the_file_says_itself_is_not_estimated(late, tmp_path):
    with pytest.raises(UsageError, match="contains its bin width"):
        import_scan(late, tmp_path / "scan.h5", estimate=["bin-width"])


def test_noise_is_refused_and_leaves_no_file(tmp_path, rig):
    noise = np.random.default_rng(0).poisson(0.3, (24, 24, BINS)).astype(float)
    scipy.io.savemat(tmp_path / "noise.mat", {"sig": noise})
    done = rig("import", "noise.mat", "scan.h5", "--bin-width", "16ps", "--estimate", "wall-size")
    assert done.code == 2
    assert "The data do not determine it" in done.err
    assert not (tmp_path / "scan.h5").exists()
