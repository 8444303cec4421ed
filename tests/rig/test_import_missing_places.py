"""Positions without a place are left out, and that is told; the others are imported as they are."""

import h5py
import numpy as np
import pytest
from test_import_curved_walls import setup

from rig.errors import DataFileError
from rig.importers import import_scan
from rig.importers.places import zeros_as_missing
from support.imaged_points import brightest, point_signal
from support.layout_files import liu2019, matlab, tal
from support.scan_files import load

#: Of a 20 x 20 grid of spots, those whose rays miss the wall: a corner and a row.
MISSED = np.zeros((20, 20), bool)
MISSED[:5, :4] = MISSED[11] = True
LOST = int(MISSED.sum())
X_M, Y_M = np.meshgrid(0.04 * (np.arange(20) - 9.5), 0.04 * (np.arange(20) - 9.5), indexing="ij")
WALL_M = np.stack([X_M, Y_M, 0 * X_M], axis=-1)
POINT_M = np.array([0.1, -0.08, 0.7])


def holed(missing):
    """The wall's places, NaN or zero where nothing was seen."""
    places_m = WALL_M.copy()
    places_m[MISSED] = missing
    return places_m


def write(folder, layout, missing, detector="one"):
    """Write a file whose missed places are NaN or zero; return its path and what must be given."""
    places_m = holed(missing)
    here_m = WALL_M.reshape(-1, 3)
    one_m = np.array([[0.06, -0.1, 0.0]])
    seen_m = here_m if detector == "confocal" else np.repeat(one_m, 400, axis=0)
    signal = point_signal(POINT_M, here_m, seen_m, 450, 16e-12)
    signal[MISSED.ravel()] = 3  # what the detector saw where it saw no wall
    if layout == "setup":
        seen = holed(missing) if detector == "confocal" else seen_m.reshape(20, 20, 3).copy()
        seen[MISSED] = missing
        return setup(folder, places_m, seen, signal), {"bin_width_s": 16e-12}
    if layout == "neutral":
        with h5py.File(folder / "a.h5", "w") as file:
            file["counts"], file["time_s"] = signal, 16e-12 * (np.arange(450) + 0.5)
            file["laser_position_m"] = places_m.reshape(-1, 3)
            file["detector_position_m"] = places_m.reshape(-1, 3) if detector == "confocal" else one_m
            file.attrs["time_origin"] = "wall"
        return folder / "a.h5", {}
    changes = {
        "H": signal.T.reshape(450, 20, 20).astype("f4"),
        "sensor_grid_xyz": places_m,
        "sensor_grid_normals": np.where(MISSED[..., None], missing, [0.0, 0.0, 1.0]),
        "laser_grid_xyz": places_m if detector == "confocal" else one_m[None],
        "delta_t": 16e-12 * 299_792_458.0,
        "t_start": 0.0,
    }
    tal(folder / "a.hdf5", **changes)
    return folder / "a.hdf5", {}


@pytest.mark.parametrize("detector", ["one", "confocal"])
@pytest.mark.parametrize("layout", ["setup", "neutral", "tal"])
@pytest.mark.parametrize("missing", [np.nan, 0.0])
def test_positions_without_a_place_are_left_out_and_counted(rig, tmp_path, layout, missing, detector):
    source, given = write(tmp_path, layout, missing, detector)
    report = import_scan(source, tmp_path / "scan.h5", **given)
    assert report.positions == 400 - LOST
    assert any(f"{LOST} of 400 positions have no place" in line for line in report.assumed)
    if missing == 0:
        assert any(f"{LOST} of 400 places are (0, 0, 0)" in line for line in report.assumed)
    capture, counts = load(tmp_path / "scan.h5")
    np.testing.assert_allclose(capture.laser_m, WALL_M[~MISSED], atol=1e-6)
    assert capture.confocal == (detector == "confocal")
    assert not (counts == 3).all(axis=1).any()
    found = brightest(rig, "scan.h5", "--wavelength", "16cm", "--depth", "0.5m:0.9m:1cm")
    # a voxel across, and two along z
    assert (np.abs(found - POINT_M) < [0.041, 0.041, 0.021]).all()


@pytest.mark.parametrize("layout", ["setup", "neutral", "tal"])
def test_a_file_without_any_place_is_refused_for_that_reason(tmp_path, monkeypatch, layout):
    monkeypatch.setattr("test_import_missing_places.MISSED", np.ones((20, 20), bool))
    source, given = write(tmp_path, layout, np.nan)
    with pytest.raises(DataFileError, match=r"none of .* 400 (positions|spots) has a place.*NaN"):
        import_scan(source, tmp_path / "scan.h5", **given)
    assert not (tmp_path / "scan.h5").exists()


def test_pairs_of_an_exhaustive_capture_lose_those_of_a_missed_pixel(tmp_path):
    signal = np.random.default_rng(3).random((6, 2, 1, 20, 20)).astype("f4")
    laser_m = np.array([[[-0.4, 0.0, 0.0]], [[0.4, 0.0, 0.0]]])
    normals = np.broadcast_to([0.0, 0.0, 1.0], (20, 20, 3))
    places = {"sensor_grid_xyz": holed(np.nan), "sensor_grid_normals": normals, "laser_grid_xyz": laser_m}
    tal(tmp_path / "a.hdf5", H=signal, H_format=("HFormat", {"T_Lx_Ly_Sx_Sy": 2}, 2), **places)
    report = import_scan(tmp_path / "a.hdf5", tmp_path / "scan.h5")
    assert any(f"{2 * LOST} of 800 positions have no place" in line for line in report.assumed)
    np.testing.assert_array_equal(load(tmp_path / "scan.h5")[1], signal[:, :, 0, ~MISSED].reshape(6, -1).T)


def test_liu_2019_leaves_missed_spots_out(tmp_path):
    spots_m = np.column_stack(
        [np.tile(np.linspace(-0.9, 0.9, 5), 3), np.repeat([-0.5, 0, 0.5], 5), np.zeros(15)]
    )
    spots_m[[3, 7]] = np.nan
    wrote = liu2019(tmp_path / "a.mat", laserPos=spots_m)
    report = import_scan(tmp_path / "a.mat", tmp_path / "scan.h5")
    assert report.positions == 13
    there = np.isfinite(spots_m).all(axis=1)
    np.testing.assert_array_equal(load(tmp_path / "scan.h5")[1], wrote["data"][:, 0, there].T)


def test_a_spot_at_the_origin_that_was_measured_is_kept(tmp_path):
    x_m, y_m = np.meshgrid(0.1 * np.arange(-2, 3), 0.1 * np.arange(-2, 3), indexing="ij")
    places_m = np.stack([x_m, y_m, 0 * x_m], axis=-1)
    tal(tmp_path / "a.hdf5", H=np.ones((4, 5, 5), "f4"), sensor_grid_xyz=places_m, sensor_grid_normals=None)
    report = import_scan(tmp_path / "a.hdf5", tmp_path / "scan.h5")
    assert report.positions == 25


@pytest.mark.parametrize(
    ("laser_m", "detector_m", "lost"),
    [
        (WALL_M.reshape(-1, 3), np.zeros((400, 3)), 0),  # a detector at the origin
        (np.zeros((400, 3)), WALL_M.reshape(-1, 3), 0),  # a laser at the origin
        (np.tile(WALL_M[:2].reshape(-1, 3) * 0, (2, 1)), np.ones((80, 3)), 0),  # one spot, again and again
        (np.tile(np.r_[WALL_M[0], np.zeros((1, 3))], (3, 1)), np.ones((63, 3)), 0),  # each spot three times
        (np.r_[WALL_M[0] + 2, np.zeros((1, 3))], np.ones((21, 3)), 1),  # one that is apart from all others
        (np.r_[WALL_M[0] + 0.42, np.zeros((1, 3))], np.ones((21, 3)), 0),  # one that is beside them
        (np.r_[WALL_M[0], np.zeros((2, 3))], np.ones((22, 3)), 2),
    ],
)
def test_zero_is_missing_only_where_no_scan_would_be_so(laser_m, detector_m, lost):
    (laser, detector), told = zeros_as_missing(laser_m, detector_m)
    assert np.isnan(laser[:, 0]).sum() == np.isnan(detector[:, 0]).sum() == lost
    assert bool(told) == bool(lost)


def test_ahn_and_lindell_leave_missed_spots_out(tmp_path):
    spots_m = np.array([[y, x, 0.5] for x in range(3) for y in range(3)], float)
    spots_m[4] = np.nan
    cube = np.arange(45.0).reshape(3, 3, 5)
    struct = {"transient": cube, "l": spots_m, "s": spots_m, "times": 0.01 * np.arange(5), "delta": 0.01}
    matlab(tmp_path / "a.mat", 5, NLOSDATA=struct)
    assert import_scan(tmp_path / "a.mat", tmp_path / "a.h5").positions == 8
    matlab(tmp_path / "b.mat", 5, meas=cube, tofgrid=np.where(np.eye(3) > 0, np.nan, 700.0))
    report = import_scan(tmp_path / "b.mat", tmp_path / "b.h5", bin_width_s=32e-12, wall_size_m=1.0)
    assert report.positions == 6
    np.testing.assert_array_equal(load(tmp_path / "b.h5")[1], cube[~np.eye(3, dtype=bool)])
