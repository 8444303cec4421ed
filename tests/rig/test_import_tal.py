"""TAL files keep their places and times, however their wall stands, and what does not fit is refused."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from rig.errors import DataFileError, UsageError
from rig.files import ScanFile
from rig.importers import import_scan
from support.imaged_points import brightest, point_signal
from support.layout_files import tal
from support.scan_files import C_M_PER_S, load


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
        ({"H_format": ("H", {"x": 2}, 2), "H": np.zeros((20, 2, 2, 3, 4))}, DataFileError, "1 laser points"),
        ({"H_format": ("H", {"x": 7}, 7)}, DataFileError, "H_format is 7;.*T_Lx_Ly_Sx_Sy"),
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


# --- polarised renders


@pytest.mark.parametrize("flat", [False, True])
def test_of_a_polarised_render_the_intensity_is_taken_and_told(tmp_path, flat):
    signal = np.random.default_rng(5).random((20, 3, 4, 4)).astype("f4")
    signal[..., 1:] -= 0.5
    stokes = signal.reshape(20, 12, 4) if flat else signal
    tal(tmp_path / "a.hdf5", flat=flat, H=stokes, scene_info="config: {mitsuba_variant: llvm_mono_polarized}")
    report = import_scan(tmp_path / "a.hdf5", tmp_path / "a.h5")
    np.testing.assert_array_equal(load(tmp_path / "a.h5")[1], signal[..., 0].reshape(20, 12).T)
    assert any("Stokes" in line and "intensity" in line for line in report.assumed)


def test_of_a_polarised_exhaustive_render_the_intensity_is_taken(tmp_path):
    signal = np.random.default_rng(5).random((9, 2, 1, 3, 4, 4)).astype("f4")
    laser_m = np.array([[[-0.4, 0.0, 0.0]], [[0.4, 0.0, 0.0]]])
    tal(tmp_path / "a.hdf5", H=signal, H_format=("HFormat", {"T_Lx_Ly_Sx_Sy": 2}, 2), laser_grid_xyz=laser_m)
    import_scan(tmp_path / "a.hdf5", tmp_path / "a.h5")
    np.testing.assert_array_equal(load(tmp_path / "a.h5")[1], signal[..., 0].reshape(9, 24).T)


def test_a_render_that_says_it_is_polarised_may_have_any_components(tmp_path):
    signal = np.random.default_rng(5).random((20, 3, 4, 13)).astype("f4")
    tal(tmp_path / "a.hdf5", H=signal, scene_info="config: {mitsuba_variant: llvm_mono_polarized}")
    import_scan(tmp_path / "a.hdf5", tmp_path / "a.h5")
    np.testing.assert_array_equal(load(tmp_path / "a.h5")[1], signal[..., 0].reshape(20, 12).T)


@pytest.mark.parametrize("last", [2, 3, 5])
def test_a_last_axis_that_is_not_known_is_refused(tmp_path, last):
    tal(tmp_path / "a.hdf5", H=np.ones((20, 3, 4, last), "f4"))
    with pytest.raises(DataFileError, match="4 Stokes components"):
        import_scan(tmp_path / "a.hdf5", tmp_path / "b.h5")


def test_grids_whose_axes_are_in_another_order_are_refused(tmp_path):
    tal(tmp_path / "a.hdf5", H=np.ones((20, 4, 3), "f4"))
    with pytest.raises(
        DataFileError, match=r"sensor_grid_xyz is a grid of \(3, 4\) points, but H has \(4, 3\)"
    ):
        import_scan(tmp_path / "a.hdf5", tmp_path / "b.h5")


# --- exhaustive captures, of which each laser point with each sensor point is a position


@pytest.mark.parametrize("flat", [False, True])
def test_a_hidden_point_of_an_exhaustive_capture_is_imaged_where_it_is(rig, tmp_path, flat):
    axis_m, point_m = 0.06 * (np.arange(16) - 7.5), np.array([0.2, -0.1, 0.7])
    x_m, y_m = np.meshgrid(axis_m, axis_m, indexing="ij")
    sensor_m = np.stack([x_m, y_m, 0 * x_m], axis=-1)
    x_m, y_m = np.meshgrid([-0.4, 0.4], [-0.4, 0.4], indexing="ij")
    laser_m = np.stack([x_m, y_m, 0 * x_m], axis=-1)
    delta_m, start_m = 0.004, 1.0
    ends_m = [one.reshape(-1, 3) for one in (laser_m, sensor_m)]
    pairs_m = np.repeat(ends_m[0], 256, axis=0), np.tile(ends_m[1], (4, 1))
    signal = point_signal(point_m, *pairs_m, 300, delta_m / C_M_PER_S, start_m / C_M_PER_S).T
    code = ("HFormat", {"T_Lx_Ly_Sx_Sy": 2, "T_Li_Si": 4}, 4 if flat else 2)
    changes = {
        "H": signal.reshape(300, *((4, 256) if flat else (2, 2, 16, 16))).astype("f4"),
        "H_format": code,
    }
    changes |= {"sensor_grid_xyz": ends_m[1] if flat else sensor_m}
    changes |= {"laser_grid_xyz": ends_m[0] if flat else laser_m, "sensor_grid_normals": None}
    tal(tmp_path / "a.hdf5", delta_t=delta_m, t_start=start_m, **changes)
    done = rig("import", "a.hdf5", "a.h5")
    assert (done.code, "each of 4 laser points with each of 256 sensor points" in done.out) == (0, True)
    capture, _ = load(tmp_path / "a.h5")
    assert capture.positions == 1024
    given = ("--wavelength", "16cm", "--depth", "0.6m:0.8m:1cm", "--width", "80cm", "--height", "80cm")
    found = brightest(rig, "a.h5", *given, "--voxel", "2cm")
    # a voxel across, and one along z
    assert (np.abs(found - point_m) < [0.021, 0.021, 0.011]).all()


def exhaustive(path, lasers, pixels, bins, **changes):
    """Write an exhaustive capture on grids of lasers and pixels, without its H unless that is given."""
    grids_m = {}
    for name, (columns, rows) in (("laser", lasers), ("sensor", pixels)):
        x_m, y_m = np.meshgrid(np.linspace(-0.4, 0.4, columns), np.linspace(-0.4, 0.4, rows), indexing="ij")
        grids_m[f"{name}_grid_xyz"] = np.stack([x_m, y_m, 0 * x_m], axis=-1)
    form = ("HFormat", {"T_Lx_Ly_Sx_Sy": 2}, 2)
    tal(path, H_format=form, **grids_m, sensor_grid_normals=None, **({"H": 0} | changes))
    if "H" not in changes:
        with h5py.File(path, "r+") as file:
            del file["H"]
            file.create_dataset("H", (bins, *lasers, *pixels), "f4", chunks=(bins, 1, 1, *pixels))
    return grids_m


@pytest.mark.parametrize("legs", [False, True])
def test_an_exhaustive_capture_keeps_each_place_once(tmp_path, legs):
    signal = np.random.default_rng(5).random((20, 2, 3, 3, 4)).astype("f4")
    grids_m = exhaustive(
        tmp_path / "a.hdf5", (2, 3), (3, 4), 20, H=signal, t_accounts_first_and_last_bounces=legs
    )
    report = import_scan(tmp_path / "a.hdf5", tmp_path / "a.h5")
    assert report.positions == 72
    with ScanFile(tmp_path / "a.h5") as scan:
        assert (scan.steps, len(scan.channels)) == (6, 12)
        np.testing.assert_allclose(scan.laser_m, grids_m["laser_grid_xyz"].reshape(-1, 3), atol=1e-15)
        np.testing.assert_array_equal(scan.counts(range(6)), signal.reshape(20, 6, 12).transpose(1, 2, 0))
        whole, capture = scan.exhaustive(), scan.capture()
        begins_s = np.broadcast_to(whole.first_bin_s, (6, 12)).ravel()
        np.testing.assert_allclose(begins_s, np.broadcast_to(capture.first_bin_s, 72), rtol=1e-12)
        assert whole.block(slice(2, 4)).positions == 24


def test_an_exhaustive_capture_is_never_whole_in_memory(tmp_path):
    """Of 0.27 GB, with 0.13 GB in a row of lasers, parts of 64 MB are held, and a copy of them."""
    if not Path("/proc/self/clear_refs").exists():
        pytest.skip("only Linux tells the peak of a part of a run")
    exhaustive(tmp_path / "a.hdf5", (2, 16), (64, 64), 512)
    exhaustive(tmp_path / "small.hdf5", (2, 2), (4, 4), 20)
    import_scan(tmp_path / "small.hdf5", tmp_path / "small.h5")  # libraries are not the import's
    Path("/proc/self/clear_refs").write_text("5")
    before = resident("VmRSS")
    import_scan(tmp_path / "a.hdf5", tmp_path / "b.h5")
    assert resident("VmHWM") - before < 200e6
    with ScanFile(tmp_path / "b.h5") as scan:
        assert (scan.steps, len(scan.channels), scan.bins) == (32, 4096, 512)


def resident(name):
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith(name))


def test_a_tal_file_without_its_start_is_told_of(tmp_path):
    tal(tmp_path / "a.hdf5", t_start=None)
    report = import_scan(tmp_path / "a.hdf5", tmp_path / "b.h5")
    assert any("t_start is missing" in line for line in report.assumed)
