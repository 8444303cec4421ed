"""Walls that are not flat keep their depth: a hidden point is imaged where it is."""

import json

import numpy as np
import pytest
import scipy.io

from rig.errors import UsageError
from rig.files import ScanFile
from rig.importers import import_scan
from support.imaged_points import brightest, point_signal
from support.layout_files import tal
from support.scan_files import load

POINT_M = np.array([0.1, -0.08, 0.7])
AROUND = ("--wavelength", "12cm", "--depth", "0.5m:0.9m:1cm")
#: Within this of the point: a voxel across (the spots' spacing is 4 cm), and two along z.
WITHIN_M = np.array([0.041, 0.041, 0.021])


def bulging(count=20):
    """(n, n, 3) whole numbers: depth index 0 to 12, x and y index of a wall that bulges into the room."""
    x, y = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    from_middle = ((x - (count - 1) / 2) ** 2 + (y - (count - 1) / 2) ** 2) / count**2
    return np.stack([np.rint(12 * np.exp(-8 * from_middle)).astype(int), x, y], axis=-1)


@pytest.mark.parametrize("confocal", [True, False])
def test_depth_indices_of_the_wall_are_kept(rig, tmp_path, confocal):
    lit = bulging().reshape(-1, 3)
    seen = lit if confocal else np.tile([12, 10, 9], (len(lit), 1))
    lit_m, seen_m = (
        np.column_stack([(one[:, 1] - 9.5) * 0.04, (one[:, 2] - 9.5) * 0.04, one[:, 0] * 0.01])
        for one in (lit, seen)
    )
    signal = point_signal(POINT_M, lit_m, seen_m, 450, 16e-12)
    for name, value in {"sub_Sig": signal, "C_i": lit, "C_d": seen}.items():
        scipy.io.savemat(tmp_path / f"{name}.mat", {name: value})
    given = ("--bin-width", "16ps", "--wall-size", "76cm")
    asked = rig("import", "sub_Sig.mat", "a.h5", *given)
    assert asked.code == 2
    assert "depth indices up to 12; give it with --depth-pitch" in asked.err
    done = rig("import", "sub_Sig.mat", "a.h5", *given, "--depth-pitch", "1cm")
    assert (done.code, "reaches z = 0.12 m" in done.out) == (0, True)
    capture, _ = load(tmp_path / "a.h5")
    np.testing.assert_allclose(capture.laser_m, lit_m, atol=1e-12)
    np.testing.assert_allclose(capture.detector_m, seen_m if confocal else seen_m[:1], atol=1e-12)
    assert (np.abs(brightest(rig, "a.h5", *AROUND) - POINT_M) < WITHIN_M).all()


def test_a_flat_wall_needs_no_depth_pitch(tmp_path):
    lit = bulging().reshape(-1, 3) * [0, 1, 1]
    for name, value in {"sub_Sig": np.ones((400, 5)), "C_i": lit, "C_d": lit}.items():
        scipy.io.savemat(tmp_path / f"{name}.mat", {name: value})
    report = import_scan(tmp_path / "sub_Sig.mat", tmp_path / "a.h5", bin_width_s=16e-12, wall_size_m=0.76)
    assert any("flat" in line for line in report.assumed)
    assert not load(tmp_path / "a.h5")[0].laser_m[:, 2].any()


def test_a_depth_pitch_must_be_a_length(tmp_path):
    lit = bulging().reshape(-1, 3)
    for name, value in {"sub_Sig": np.ones((400, 5)), "C_i": lit, "C_d": lit}.items():
        scipy.io.savemat(tmp_path / f"{name}.mat", {name: value})
    given = {"bin_width_s": 16e-12, "wall_size_m": 0.76}
    with pytest.raises(UsageError, match="must be positive"):
        import_scan(tmp_path / "sub_Sig.mat", tmp_path / "a.h5", **given, depth_pitch_m=-0.01)


# --- f-k scans of a wall that is not flat


@pytest.mark.parametrize("held_in", ["a.mat", "tof.mat", "calibration.mat"])
def test_fk_scans_take_the_depth_of_the_wall(rig, tmp_path, held_in):
    spots_m = bulging_m()
    spots_m[:, 1] *= -1  # y falls along the second axis
    flight_ps = np.random.default_rng(4).uniform(500, 900, (20, 20))
    signal = point_signal(POINT_M, spots_m, spots_m, 520, 16e-12, -flight_ps.ravel() * 1e-12)
    files = {"a.mat": {"meas": signal.reshape(20, 20, 520)}, "tof.mat": {"tofgrid": flight_ps}}
    files["tof.mat"]["pos"] = np.ones((20, 20, 3))
    for name, variables in files.items():
        scipy.io.savemat(tmp_path / name, variables)
    given = ("--bin-width", "16ps", "--wall-size", "76cm")
    flat = rig("import", "a.mat", "a.h5", *given)
    assert (flat.code, "tof.mat holds 'pos': the wall is not flat" in flat.err) == (5, True)
    depth = {"z_offset": spots_m[:, 2].reshape(20, 20)}
    scipy.io.savemat(tmp_path / held_in, files.get(held_in, {}) | depth)
    assert rig("import", "a.mat", "a.h5", *given).code == 0
    np.testing.assert_allclose(load(tmp_path / "a.h5")[0].laser_m, spots_m, atol=1e-9)
    assert (np.abs(brightest(rig, "a.h5", *AROUND) - POINT_M) < WITHIN_M).all()


# --- laser and detector points in metres


def setup(folder, laser_m, detector_m, signal, count=20):
    """Write data.mat and setup.mat as CC-SOCR and general-NLOS do."""
    folder.mkdir(exist_ok=True)
    scipy.io.savemat(folder / "data.mat", {"data": signal.reshape(count, count, -1)})
    points = {
        "laserpoints": laser_m.reshape(count, count, 3),
        "detectpoints": detector_m.reshape(count, count, 3),
    }
    scipy.io.savemat(folder / "setup.mat", points)
    return folder / "data.mat"


def bulging_m(shift_m=(0.0, 0.0, 0.0)):
    index = bulging().reshape(-1, 3)
    return (index[:, [1, 2, 0]] - [9.5, 9.5, 0]) * [0.04, 0.04, 0.01] + shift_m


@pytest.mark.parametrize("detector", ["one spot", "confocal"])
@pytest.mark.parametrize(
    ("shift_m", "moved_m"),
    [
        ((0.0, 0.0, 0.0), None),
        ((0.05, -0.1, 0.03), None),  # the origin is amid the spots, and the wall reaches from z = 3 to 15 cm
        ((0.38, 0.38, 0.0), (0.38, 0.38, 0.0)),  # counted from a corner
        ((0.0, 0.0, -2.5), (0.0, 0.0, -2.44)),  # seen from the mirror
        ((1.4, 0.2, -2.5), (1.4, 0.2, -2.44)),
    ],
)
def test_places_are_moved_only_where_they_must_be_and_told(rig, tmp_path, detector, shift_m, moved_m):
    laser_m = bulging_m(shift_m)
    point_m = POINT_M + shift_m
    seen_m = laser_m if detector == "confocal" else np.tile(np.array([0.1, -0.05, -0.05]) + shift_m, (400, 1))
    setup(tmp_path, laser_m, seen_m, point_signal(point_m, laser_m, seen_m, 450, 16e-12))
    done = rig("import", "data.mat", "a.h5", "--bin-width", "16ps", "--json")
    assert done.code == 0, done.err
    capture, _ = load(tmp_path / "a.h5")
    with ScanFile(tmp_path / "a.h5") as scan:
        imported = scan.imported
    if moved_m is None:
        assert "moved" not in imported
        assert any("nothing was moved" in line for line in json.loads(done.out)["assumed"])
    else:
        np.testing.assert_allclose(imported["moved"]["origin_m"], moved_m, atol=1e-9)
        numbers = ", ".join(f"{value:.6g}" for value in np.array(moved_m) + 0.0)
        assert any(f"({numbers}) m" in line for line in json.loads(done.out)["assumed"])
    np.testing.assert_allclose(capture.laser_m, laser_m - (moved_m or 0.0), atol=1e-6)
    np.testing.assert_allclose(
        capture.detector_m, (seen_m if detector == "confocal" else seen_m[:1]) - (moved_m or 0.0), atol=1e-6
    )


def test_a_point_before_a_wall_in_metres_is_imaged_where_it_is(rig, tmp_path):
    laser_m = bulging_m()
    seen_m = np.tile([0.075, 0.142, -0.05], (400, 1))
    setup(tmp_path, laser_m, seen_m, point_signal(POINT_M, laser_m, seen_m, 450, 16e-12))
    assert rig("import", "data.mat", "a.h5", "--bin-width", "16ps").code == 0
    assert (np.abs(brightest(rig, "a.h5", *AROUND) - POINT_M) < WITHIN_M).all()


def test_a_tal_wall_that_is_not_flat_stays_where_it_stands(tmp_path):
    places_m = bulging_m().reshape(20, 20, 3)
    normals = np.broadcast_to([0.1, 0.0, 0.995], places_m.shape)
    tal(
        tmp_path / "a.hdf5",
        H=np.ones((5, 20, 20), "f4"),
        sensor_grid_xyz=places_m,
        sensor_grid_normals=normals,
    )
    report = import_scan(tmp_path / "a.hdf5", tmp_path / "a.h5")
    np.testing.assert_array_equal(load(tmp_path / "a.h5")[0].laser_m, places_m.reshape(-1, 3))
    assert any("nothing was moved" in line for line in report.assumed)
