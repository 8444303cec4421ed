"""Published layouts become scan files with the same photons, places and times, or are refused."""

import h5py
import numpy as np
import pytest
import scipy.io

from rig.errors import DataFileError, UsageError
from rig.files import ScanFile
from rig.importers import import_scan
from support.layout_files import lct, liu2019
from support.published import published
from support.scan_files import C_M_PER_S, load

# --- O'Toole 2018


def test_lct_has_x_rising_and_y_falling(tmp_path):
    data = np.zeros((3, 4, 20))
    data[2, 0, 7] = 9  # last along x, first along y: right and up
    lct(tmp_path / "a.mat", rect_data=data)
    report = import_scan(tmp_path / "a.mat", tmp_path / "a.h5", bin_width_s=4e-12)
    capture, counts = load(tmp_path / "a.h5")
    assert report.layout == "O'Toole 2018, LCT"
    assert (report.positions, report.bins, report.time_origin) == (12, 20, "wall")
    (where,) = np.flatnonzero(counts.sum(axis=1))
    np.testing.assert_allclose(capture.laser_m[where], [0.5, 0.5, 0])
    assert counts[where, 7] == 9
    assert capture.confocal
    assert capture.first_bin_s == [0.0]
    with ScanFile(tmp_path / "a.h5") as again:
        assert not again.expectation
        assert again.status == "complete"
        assert again.imported["file"] == "a.mat"
        assert again.imported["assumed"] == list(report.assumed)
        assert again.fade_from_s == 2.4e-9
        assert "imported from a.mat" in str(again)


@pytest.mark.parametrize("axes", [(2, 0, 1), (0, 2, 1)])
@pytest.mark.parametrize("version", [5, 7.3])
def test_a_cube_with_time_on_another_axis_is_refused(tmp_path, axes, version):
    """Read as it stands, it would be a picture of nothing, on a grid of 20 x 3 spots."""
    cube = np.random.default_rng(4).poisson(2.0, (3, 3, 20)).transpose(axes)
    if version == 5:
        lct(tmp_path / "a.mat", rect_data=cube)
    else:
        with h5py.File(tmp_path / "a.mat", "w") as file:
            file["rect_data"], file["width"] = cube.T, [[0.5]]
    with pytest.raises(DataFileError, match="time must be its last axis; of a square of 3 x 3 spots"):
        import_scan(tmp_path / "a.mat", tmp_path / "a.h5", bin_width_s=4e-12)


def test_one_line_of_a_grid_lies_in_the_middle(tmp_path):
    lct(tmp_path / "a.mat", rect_data=np.ones((1, 4, 20)))
    import_scan(tmp_path / "a.mat", tmp_path / "a.h5", bin_width_s=4e-12)
    np.testing.assert_array_equal(load(tmp_path / "a.h5")[0].laser_m[:, 0], 0.0)


def test_spacings_of_a_grid_that_is_no_square_are_told(tmp_path):
    report = import_scan(lct(tmp_path / "a.mat"), tmp_path / "a.h5", bin_width_s=4e-12)
    assert any("50 cm apart along x and 33.3 cm along y" in line for line in report.assumed)


def test_lct_needs_its_bin_width(tmp_path):
    lct(tmp_path / "a.mat")
    with pytest.raises(UsageError, match=r"--bin-width.*4ps"):
        import_scan(tmp_path / "a.mat", tmp_path / "a.h5")
    assert not (tmp_path / "a.h5").exists()


def test_lct_processed_values_are_no_photons(tmp_path):
    lct(tmp_path / "a.mat", rect_data=np.full((3, 4, 20), 0.25))
    import_scan(tmp_path / "a.mat", tmp_path / "a.h5", bin_width_s=4e-12)
    _, counts = load(tmp_path / "a.h5")
    np.testing.assert_array_equal(counts, 0.25)


def test_lct_as_published(tmp_path):
    import_scan(published("original/lct/data_s_u.mat"), tmp_path / "a.h5", bin_width_s=4e-12)
    capture, counts = load(tmp_path / "a.h5")
    with h5py.File(published("lct_su.h5")) as other:
        np.testing.assert_allclose(capture.laser_m, other["laser_position_m"][()], atol=1e-6)
        np.testing.assert_array_equal(counts.reshape(4096, 512, 4).sum(axis=2), other["counts"][()])
        first_edge_s = other["time_s"][0] - other.attrs["bin_width_s"] / 2
        assert capture.first_bin_s[0] == pytest.approx(first_edge_s, abs=1e-15)


# --- Liu 2019


@pytest.mark.parametrize("transposed", [False, True])
def test_liu_2019_time_is_rectified_for_each_position(tmp_path, transposed):
    wrote = liu2019(tmp_path / "a.mat", transposed)
    report = import_scan(tmp_path / "a.mat", tmp_path / "a.h5")
    capture, counts = load(tmp_path / "a.h5")
    assert (report.layout, report.time_origin) == ("Liu 2019, phasor field", "laser")
    np.testing.assert_array_equal(counts, wrote["data"][:, 0, :].T)
    np.testing.assert_array_equal(capture.laser_m, wrote["laserPos"])
    np.testing.assert_array_equal(capture.detector_m, wrote["cameraPos"])
    assert capture.bin_width_s == pytest.approx(0.0012 / C_M_PER_S, rel=1e-15)
    back_m = np.linalg.norm(wrote["cameraPos"][0] - wrote["cameraOrigin"].ravel())
    for position, spot in enumerate(wrote["laserPos"]):
        out_m = np.linalg.norm(spot - wrote["laserOrigin"].ravel())
        assert capture.first_bin_s[position] == pytest.approx((4.5 - out_m - back_m) / C_M_PER_S, abs=1e-20)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"data": np.zeros((30, 2, 15))}, "one camera point"),
        ({"cameraPos": np.zeros((2, 3))}, "one camera point"),
        ({"laserPos": np.zeros((15, 2))}, "laserPos has shape"),
        ({"t0": np.zeros((2, 1))}, "t0"),
        ({"deltat": np.zeros((1, 1))}, "must be positive"),
    ],
)
def test_a_liu_2019_file_that_does_not_fit_is_refused(tmp_path, changes, said):
    liu2019(tmp_path / "a.mat", **changes)
    with pytest.raises(DataFileError, match=said):
        import_scan(tmp_path / "a.mat", tmp_path / "b.h5")


# --- Ahn, Xiao, Wu, CC-SOCR: written here for their shapes, read as published for their places


@pytest.mark.parametrize(
    ("original", "name", "given"),
    [
        ("ahn/2019_transient.mat", "ahn_2019", {}),
        ("xiao18m/4.mat", "xiao18m_L", {"bin_width_s": 32e-12, "wall_size_m": 0.82}),
        ("cc_socr/statue/full/sub_Sig.mat", "fk_statue", {"bin_width_s": 32e-12, "wall_size_m": 2.0}),
        (
            "cc_socr/figure_4/full/sub_Sig.mat",
            "phasor_figure4_nonconfocal",
            {"bin_width_s": 16e-12, "wall_size_m": 1.26},
        ),
    ],
)
def test_as_published_equals_the_neutral_file(tmp_path, original, name, given):
    import_scan(published(f"original/{original}"), tmp_path / "a.h5", **given)
    capture, counts = load(tmp_path / "a.h5")
    with h5py.File(published(f"{name}.h5")) as other:
        signal = other["counts" if "counts" in other else "transient"][()]
        # single precision of values near one
        np.testing.assert_allclose(counts, signal, atol=1e-6)
        np.testing.assert_allclose(capture.laser_m, other["laser_position_m"][()], atol=1e-6)
        np.testing.assert_allclose(capture.detector_m, other["detector_position_m"][()], atol=1e-6)
        assert capture.bin_width_s == pytest.approx(other.attrs["bin_width_s"], rel=1e-6)
        first_edge_s = other["time_s"][0] - other.attrs["bin_width_s"] / 2
        assert capture.first_bin_s[0] == pytest.approx(first_edge_s, abs=1e-15)


@pytest.mark.parametrize(
    ("scene", "pitch_m", "name", "filled"),
    # 200 spots were chosen of each; of the figure 4, three of these are empty in the full scan too
    [("statue", 2 / 63, "fk_statue", 200), ("figure_4", 0.01, "phasor_figure4_nonconfocal", 197)],
)
def test_chosen_spots_as_published_are_those_of_the_full_scan(tmp_path, scene, pitch_m, name, filled):
    original = published(f"original/cc_socr/{scene}/random/data.mat")
    import_scan(original, tmp_path / "a.h5", bin_width_s=16e-12)
    capture, counts = load(tmp_path / "a.h5")
    with h5py.File(published(f"{name}.h5")) as other:
        # in halves of the pitch, since the middle of an even number of spots lies between two
        index = np.rint(other["laser_position_m"][:, :2] / pitch_m * 2)
        full = {tuple(place): row for place, row in zip(index, other["counts"][()], strict=True)}
        if not capture.confocal:
            np.testing.assert_allclose(capture.detector_m, other["detector_position_m"][()], atol=1e-6)
    assert capture.positions == filled
    for spot_m, row in zip(capture.laser_m, counts, strict=True):
        np.testing.assert_array_equal(row, full[tuple(np.rint(spot_m[:2] / pitch_m * 2))])


def test_a_cube_takes_its_spots_from_setup(tmp_path):
    lit_m = np.zeros((2, 2, 3))
    lit_m[..., 0], lit_m[..., 1] = np.meshgrid([0.0, 0.4], [0.0, 0.6], indexing="ij")
    scipy.io.savemat(tmp_path / "data.mat", {"data": np.arange(20.0).reshape(2, 2, 5)})
    with pytest.raises(DataFileError, match="no known layout"):
        import_scan(tmp_path / "data.mat", tmp_path / "a.h5", bin_width_s=16e-12)
    seen_m = np.tile([0.1, 0.2, 0.0], (2, 2, 1))
    scipy.io.savemat(tmp_path / "setup.mat", {"laserpoints": lit_m, "detectpoints": seen_m})
    with pytest.raises(UsageError, match="--bin-width"):
        import_scan(tmp_path / "data.mat", tmp_path / "a.h5")
    import_scan(tmp_path / "data.mat", tmp_path / "a.h5", bin_width_s=16e-12)
    capture, counts = load(tmp_path / "a.h5")
    np.testing.assert_allclose(capture.laser_m[1], [-0.2, 0.3, 0])
    np.testing.assert_allclose(capture.detector_m, [[-0.1, -0.1, 0]])
    np.testing.assert_array_equal(counts[1], np.arange(5, 10))
    scipy.io.savemat(tmp_path / "setup.mat", {"laserpoints": lit_m[:1], "detectpoints": seen_m})
    with pytest.raises(DataFileError, match="2 laser and 4 detector points"):
        import_scan(tmp_path / "data.mat", tmp_path / "b.h5", bin_width_s=16e-12)


def test_a_slow_record_is_read_with_its_instrument_response(tmp_path):
    report = import_scan(published("original/km143/mannequin.mat"), tmp_path / "a.h5")
    assert any("mirrored" in line for line in report.assumed)
    with ScanFile(tmp_path / "a.h5") as scan:
        assert 0.7e-9 < scan.instrument_response_s < 0.8e-9


def test_what_these_files_lack_is_asked_for_by_name(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"sig": np.ones((3, 4, 5))})
    with pytest.raises(UsageError, match="--bin-width"):
        import_scan(tmp_path / "a.mat", tmp_path / "b.h5")
    with pytest.raises(UsageError, match="--wall-size"):
        import_scan(tmp_path / "a.mat", tmp_path / "b.h5", bin_width_s=32e-12)
    with pytest.raises(UsageError, match="must be positive"):
        import_scan(tmp_path / "a.mat", tmp_path / "b.h5", bin_width_s=-1.0)
    import_scan(tmp_path / "a.mat", tmp_path / "b.h5", bin_width_s=32e-12, wall_size_m=1.0)
    capture, _ = load(tmp_path / "b.h5")
    np.testing.assert_allclose(capture.laser_m[1], [-0.5, -0.5 + 1 / 3, 0])


@pytest.mark.parametrize(
    ("variables", "said"),
    [
        ({"sub_Sig": np.ones((4, 9))}, r"C_i\.mat does not exist"),
        ({"sig": np.ones((4, 9))}, "cube"),
        ({"NLOSDATA": {"transient": np.ones((2, 2, 3)), "l": np.ones((4, 3))}}, "lacks s, times, delta"),
        ({"NLOSDATA": np.ones(3)}, "lacks"),
        ({"sig_in": np.ones((2, 2, 3)), "timeRes": "slow", "width": 0.4}, "timeRes"),
        ({"rect_data": np.ones((2, 2, 3)), "width": -0.4}, "positive size"),
    ],
)
def test_files_that_do_not_fit_are_refused(tmp_path, variables, said):
    scipy.io.savemat(tmp_path / "a.mat", variables)
    with pytest.raises(DataFileError, match=said):
        import_scan(tmp_path / "a.mat", tmp_path / "b.h5", bin_width_s=32e-12, wall_size_m=1.0)
    assert not (tmp_path / "b.h5").exists()


def test_pairs_of_spots_lie_where_their_indices_say(tmp_path):
    lit = np.array([[0, 0, 8], [0, 8, 0], [0, 4, 4]])
    scipy.io.savemat(tmp_path / "sub_Sig.mat", {"sub_Sig": np.arange(15.0).reshape(3, 5)})
    scipy.io.savemat(tmp_path / "C_i.mat", {"C_i": lit})
    scipy.io.savemat(tmp_path / "C_d.mat", {"C_d": np.tile([0, 6, 2], (3, 1))})
    import_scan(tmp_path / "sub_Sig.mat", tmp_path / "a.h5", bin_width_s=16e-12, wall_size_m=0.8)
    capture, counts = load(tmp_path / "a.h5")
    np.testing.assert_allclose(capture.laser_m, [[-0.4, 0.4, 0], [0.4, -0.4, 0], [0, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(capture.detector_m, [[0.2, -0.2, 0]], atol=1e-15)
    np.testing.assert_array_equal(counts, np.arange(15).reshape(3, 5))
