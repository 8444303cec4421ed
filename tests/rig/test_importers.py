"""Files of other layouts become scan files with the same photons, places and times, or are refused."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from rig.errors import DataFileError, UsageError
from rig.files import ScanFile
from rig.importers import import_scan

C_M_PER_S = 299_792_458.0
DATA = Path(__file__).parents[2].parent / "shared" / "data"
measured = pytest.mark.skipif(not DATA.is_dir(), reason=f"the published measurements are not at {DATA}")


def load(path):
    with ScanFile(path) as scan:
        capture = scan.capture()
        return capture, np.concatenate([block for _, block in capture.histograms.blocks()])


# --- O'Toole 2018


def lct(path, **changes):
    rng = np.random.default_rng(4)
    variables = {"rect_data": rng.poisson(2.0, (3, 4, 20)).astype(float), "width": 0.5}
    scipy.io.savemat(path, variables | changes)
    return path


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


@measured
def test_lct_as_published(tmp_path):
    import_scan(DATA / "original" / "lct" / "data_s_u.mat", tmp_path / "a.h5", bin_width_s=4e-12)
    capture, counts = load(tmp_path / "a.h5")
    with h5py.File(DATA / "lct_su.h5") as other:
        np.testing.assert_allclose(capture.laser_m, other["laser_position_m"][()], atol=1e-6)
        np.testing.assert_array_equal(counts.reshape(4096, 512, 4).sum(axis=2), other["counts"][()])
        first_edge_s = other["time_s"][0] - other.attrs["bin_width_s"] / 2
        assert capture.first_bin_s[0] == pytest.approx(first_edge_s, abs=1e-15)


# --- the neutral layout


def neutral(path, name="counts", **changes):
    rng = np.random.default_rng(6)
    variables = {
        name: rng.poisson(1.0, (300, 30)).astype("u2"),
        "laser_position_m": rng.normal(size=(300, 3)),
        "detector_position_m": np.zeros((1, 3)),
        "time_s": 5e-9 + 16e-12 * np.arange(30),
    } | changes
    with h5py.File(path, "w") as file:
        for key, value in variables.items():
            file[key] = value
        file.attrs.update({"bin_width_s": 16e-12, "gate_start_s": 2.4e-9, "simulated": True})
    return variables


def test_neutral_layout(tmp_path):
    wrote = neutral(tmp_path / "a.h5")
    assert import_scan(tmp_path / "a.h5", tmp_path / "b.h5").layout == "neutral HDF5"
    capture, counts = load(tmp_path / "b.h5")
    np.testing.assert_array_equal(counts, wrote["counts"])
    np.testing.assert_array_equal(capture.laser_m, wrote["laser_position_m"])
    assert capture.first_bin_s[0] == pytest.approx(5e-9 - 8e-12, abs=1e-20)
    with ScanFile(tmp_path / "b.h5") as again:
        assert again.fade_from_s == 2.4e-9
        assert again.simulated


def test_neutral_expectations_stay_floats(tmp_path):
    signal = np.random.default_rng(1).random((300, 30), "f4")
    neutral(tmp_path / "a.h5", "transient", transient=signal)
    import_scan(tmp_path / "a.h5", tmp_path / "b.h5", fade_from_s=1e-9)
    with ScanFile(tmp_path / "b.h5") as scan:
        assert scan.expectation
        assert scan.fade_from_s == 1e-9
    np.testing.assert_array_equal(load(tmp_path / "b.h5")[1], signal)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"transient": np.zeros((300, 30), "f4")}, "both counts and transient"),
        ({"time_s": np.arange(29) * 16e-12}, "29 bin centres"),
        ({"time_s": np.arange(30.0) ** 2 * 1e-12}, "not evenly spaced"),
        ({"laser_position_m": np.zeros((299, 3))}, "299 laser positions"),
        ({"laser_position_m": np.full((300, 3), np.nan)}, "finite numbers"),
        ({"counts": np.full((300, 30), np.nan)}, "not a finite number"),
        ({"counts": np.zeros((300, 30), complex)}, "not real numbers"),
    ],
)
def test_a_neutral_file_that_does_not_fit_is_refused(tmp_path, changes, said):
    neutral(tmp_path / "a.h5", **changes)
    with pytest.raises(DataFileError, match=said):
        import_scan(tmp_path / "a.h5", tmp_path / "b.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]


@measured
@pytest.mark.parametrize(
    "name", ["ahn_2019", "phasor_figure4_nonconfocal", "rendered_letters_g32", "xiao18m_L"]
)
def test_neutral_layout_as_published(tmp_path, name):
    import_scan(DATA / f"{name}.h5", tmp_path / "a.h5")
    capture, counts = load(tmp_path / "a.h5")
    with h5py.File(DATA / f"{name}.h5") as other:
        np.testing.assert_array_equal(counts, other["counts" if "counts" in other else "transient"][()])
        np.testing.assert_array_equal(capture.laser_m, other["laser_position_m"][()])
        np.testing.assert_array_equal(capture.detector_m, other["detector_position_m"][()])


# --- TAL


def tal(path, *, legs=False, confocal=False, flat=False, turn=None, normals=True, move=(0, 0, 0), **changes):
    """Write a file as y-tal does: enums of shape (1,), None as an empty dataset, metres for time."""
    turn = np.eye(3) if turn is None else turn
    x_m, y_m = np.meshgrid(np.linspace(-0.5, 0.5, 3), np.linspace(-0.4, 0.4, 4), indexing="ij")
    grid_m = np.stack([x_m, y_m, 0 * x_m], axis=-1) @ turn.T + move
    signal = np.random.default_rng(8).random((20, 3, 4), "f4")
    if flat:
        grid_m, signal = grid_m.reshape(-1, 3), signal.reshape(20, -1)
    variables = {
        "H": signal,
        "H_format": ("HFormat", {"T_Sx_Sy": 1, "T_Si": 3}, 3 if flat else 1),
        "sensor_xyz": np.array([0.1, 0.2, 1.5]) @ turn.T + move,
        "sensor_grid_xyz": grid_m,
        "sensor_grid_normals": np.broadcast_to(turn[:, 2], grid_m.shape) if normals else None,
        "sensor_grid_format": ("GridFormat", {"N_3": 1, "X_Y_3": 2}, 1 if flat else 2),
        "laser_xyz": np.array([-0.3, 0.1, 1.2]) @ turn.T + move,
        "laser_grid_xyz": grid_m if confocal else (np.array([[[0.05, -0.1, 0.0]]]) @ turn.T + move),
        "laser_grid_normals": None,
        "laser_grid_format": ("GridFormat", {"N_3": 1, "X_Y_3": 2}, 2),
        "volume_format": None,
        "delta_t": 0.003,
        "t_start": 1.5,
        "t_accounts_first_and_last_bounces": legs,
        "scene_info": "original_format: none\n",
    } | changes
    with h5py.File(path, "w") as file:
        for key, value in variables.items():
            if value is None:
                file[key] = h5py.Empty(float)
            elif isinstance(value, tuple):
                dataset = file.create_dataset(key, (1,), h5py.enum_dtype(value[1], basetype="i"))
                dataset[0] = value[2]
            else:
                file[key] = value
    return variables


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("confocal", [False, True])
def test_tal_keeps_places_and_times(tmp_path, confocal, flat):
    wrote = tal(tmp_path / "a.hdf5", confocal=confocal, flat=flat)
    report = import_scan(tmp_path / "a.hdf5", tmp_path / "a.h5")
    capture, counts = load(tmp_path / "a.h5")
    assert (report.layout, report.time_origin) == ("TAL", "wall")
    grid_m = wrote["sensor_grid_xyz"].reshape(-1, 3)
    signal = wrote["H"].reshape(20, -1)
    for position in range(12):
        np.testing.assert_allclose(capture.laser_m[position], grid_m[position], atol=1e-15)
        np.testing.assert_array_equal(counts[position], signal[:, position])
    assert capture.confocal == confocal
    if not confocal:
        np.testing.assert_allclose(capture.detector_m, [[0.05, -0.1, 0.0]], atol=1e-15)
    assert capture.bin_width_s == pytest.approx(0.003 / C_M_PER_S, rel=1e-15)
    assert capture.first_bin_s[0] == pytest.approx(1.5 / C_M_PER_S, rel=1e-15)


@pytest.mark.parametrize("moved", [False, True])
def test_tal_time_with_legs_is_rectified_for_each_position(tmp_path, moved):
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    placing = {"turn": turn, "move": (4.0, 1.0, -2.0)} if moved else {}
    wrote = tal(tmp_path / "a.hdf5", legs=True, **placing)
    report = import_scan(tmp_path / "a.hdf5", tmp_path / "a.h5")
    capture, _ = load(tmp_path / "a.h5")
    assert report.time_origin == "laser"
    laser_leg_m = np.linalg.norm(wrote["laser_grid_xyz"].ravel() - wrote["laser_xyz"])
    for position, spot in enumerate(wrote["sensor_grid_xyz"].reshape(-1, 3)):
        sensor_leg_m = np.linalg.norm(spot - wrote["sensor_xyz"])
        expected_s = (1.5 - laser_leg_m - sensor_leg_m) / C_M_PER_S
        # a rigid motion in double precision keeps metres to 1e-15 and so nanoseconds to 1e-23
        assert capture.first_bin_s[position] == pytest.approx(expected_s, abs=1e-20)


def test_tal_wall_elsewhere_is_moved_without_mirroring(tmp_path):
    # a wall in the plane x = 4 that looks along +x; its right for one who faces it:
    # y up, z out of the wall = +x, so x = y cross z = (0, 1, 0) x (1, 0, 0) = (0, 0, -1)
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    for number, normals in enumerate([True, False]):
        wrote = tal(tmp_path / f"{number}.hdf5", turn=turn, move=(4.0, 1.0, 0.0), normals=normals)
        report = import_scan(tmp_path / f"{number}.hdf5", tmp_path / f"{number}.h5")
        capture, _ = load(tmp_path / f"{number}.h5")
        grid_m = wrote["sensor_grid_xyz"].reshape(-1, 3)
        np.testing.assert_allclose(capture.laser_m[:, 2], 0, atol=1e-12)
        np.testing.assert_allclose(capture.laser_m[:, 1], grid_m[:, 1] - 1.0, atol=1e-12)
        np.testing.assert_allclose(capture.laser_m[:, 0], -grid_m[:, 2], atol=1e-12)
        assert any("moved onto z = 0" in line for line in report.assumed)


@pytest.mark.parametrize(
    ("changes", "error", "said"),
    [
        ({"H_format": ("H", {"x": 2}, 2), "H": np.zeros((20, 2, 2, 3, 4))}, DataFileError, "T_Lx_Ly_Sx_Sy"),
        ({"H_format": ("H", {"x": 10}, 10)}, DataFileError, "frequency domain"),
        ({"H": np.zeros((20, 3, 5), "f4")}, DataFileError, "12 sensor points"),
        ({"laser_grid_xyz": np.zeros((5, 3))}, DataFileError, "5 laser points"),
        ({"delta_t": 0.0}, DataFileError, "delta_t"),
        ({"delta_t": None}, DataFileError, "'delta_t'"),
        ({"t_accounts_first_and_last_bounces": None}, UsageError, "--time-origin"),
        ({"t_accounts_first_and_last_bounces": True, "laser_xyz": None}, DataFileError, "laser_xyz"),
        ({"sensor_grid_xyz": np.zeros((3, 4, 3)), "sensor_grid_normals": None}, DataFileError, "one line"),
    ],
)
def test_a_tal_file_that_does_not_fit_is_refused(tmp_path, changes, error, said):
    tal(tmp_path / "a.hdf5", **changes)
    with pytest.raises(error, match=said):
        import_scan(tmp_path / "a.hdf5", tmp_path / "b.h5")
    assert not (tmp_path / "b.h5").exists()


def test_a_tal_file_without_the_flag_is_read_as_told(tmp_path):
    tal(tmp_path / "a.hdf5", t_accounts_first_and_last_bounces=None)
    assert import_scan(tmp_path / "a.hdf5", tmp_path / "b.h5", time_origin="laser").time_origin == "laser"


# --- everything else


def test_unknown_content_is_listed_with_what_is_known(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"picture": np.zeros((3, 4)), "name": "x"})
    with h5py.File(tmp_path / "b.mat", "w", userblock_size=512) as file:
        file["volume"] = np.zeros((2, 2))
    with open(tmp_path / "b.mat", "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + b"\0" * 8 + b"\x00\x02IM")
    for name, found in (("a.mat", r"picture \(3, 4\)"), ("b.mat", r"volume \(2, 2\)")):
        with pytest.raises(DataFileError, match=rf"no known layout; it holds .*{found}.*rect_data.*H_format"):
            import_scan(tmp_path / name, tmp_path / "c.h5")


def test_two_readings_are_refused(tmp_path):
    neutral(tmp_path / "a.h5", H=np.zeros((20, 3, 4)), H_format=1)
    with pytest.raises(DataFileError, match="neutral HDF5 and as TAL"):
        import_scan(tmp_path / "a.h5", tmp_path / "b.h5")


def test_no_target_is_overwritten(tmp_path):
    lct(tmp_path / "a.mat")
    (tmp_path / "b.h5").write_bytes(b"precious")
    with pytest.raises(UsageError, match="not overwritten"):
        import_scan(tmp_path / "a.mat", tmp_path / "b.h5", bin_width_s=4e-12)
    assert (tmp_path / "b.h5").read_bytes() == b"precious"


def test_damaged_files_are_refused_and_leave_nothing(tmp_path):
    lct(tmp_path / "whole.mat")
    tal(tmp_path / "whole.hdf5")
    rng = np.random.default_rng(12)
    refused = 0
    for name in ("whole.mat", "whole.hdf5"):
        content = (tmp_path / name).read_bytes()
        for number in range(60):
            damaged = bytearray(content[: int(rng.integers(len(content)))] if number % 2 else content)
            for place in rng.integers(0, len(damaged) + 1, 30):
                if place < len(damaged):
                    damaged[place] = rng.integers(256)
            path, target = tmp_path / f"damaged-{name}", tmp_path / "target.h5"
            path.write_bytes(damaged)
            try:
                import_scan(path, target, bin_width_s=4e-12, time_origin="wall")
                target.unlink()
            except DataFileError:
                refused += 1
                assert not target.exists()
    assert refused > 60
    assert not list(tmp_path.glob(".*"))


def test_the_digest_is_that_of_the_source(tmp_path):
    import hashlib

    neutral(tmp_path / "a.h5")
    import_scan(tmp_path / "a.h5", tmp_path / "b.h5")
    with h5py.File(tmp_path / "b.h5") as file:
        said = json.loads(file["start"].attrs["imported"])["sha256"]
    assert said == hashlib.sha256((tmp_path / "a.h5").read_bytes()).hexdigest()
