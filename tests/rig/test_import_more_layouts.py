"""Liu 2020, Lindell 2019, Z-NLOS and exhaustive TAL: each photon keeps its place and its time."""

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rig.errors import DataFileError, UsageError
from rig.files import ScanFile
from rig.importers import import_scan
from support.layout_files import matlab, tal, znlos
from support.scan_files import C_M_PER_S, load

# the folder is the same for all examples, and each writes its files anew
EXAMPLES = settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
SIZES = st.integers(1, 4)


def imported(path, **given):
    target = path.with_suffix(".scan")
    target.unlink(missing_ok=True)
    return import_scan(path, target, **given), target


# --- Liu 2020


@EXAMPLES
@given(rows=st.integers(2, 4), columns=st.integers(2, 4), data=st.data(), version=st.sampled_from([5, 7.3]))
def test_liu_2020_keeps_rows_and_columns(tmp_path, rows, columns, data, version):
    row, column, bin_ = (data.draw(st.integers(0, size - 1)) for size in (rows, columns, 6))
    seen = (data.draw(st.integers(0, rows - 1)), data.draw(st.integers(0, columns - 1)))
    cube = np.zeros((rows, columns, 6), "u2")
    cube[row, column, bin_] = 7
    spacing = {"ts": 4e-12, "SPAD_index": np.array(seen) + 1, "sampling_spacing": 0.01}
    matlab(tmp_path / "a.mat", version, rect_data=cube, **spacing)
    report, target = imported(tmp_path / "a.mat")
    capture, counts = load(target)
    assert (report.layout, report.time_origin) == ("Liu 2020, diffraction", "wall")
    (where,) = np.flatnonzero(counts[:, bin_])

    def place(row, column):
        return [(column - (columns - 1) / 2) * 0.01, ((rows - 1) / 2 - row) * 0.01, 0]

    assert counts.sum() == 7
    np.testing.assert_allclose(capture.laser_m[where], place(row, column), atol=1e-15)
    np.testing.assert_allclose(capture.detector_m, [place(*seen)], atol=1e-15)
    assert (capture.bin_width_s, capture.first_bin_s[0]) == (4e-12, 0.0)
    assert any("mirrored or turned" in line for line in report.assumed)


@pytest.mark.parametrize(
    ("changes", "error", "said"),
    [
        ({"SPAD_index": [0, 2]}, DataFileError, "outside of the grid"),
        ({"rect_data": np.ones((3, 4))}, DataFileError, "cube"),
        ({"ts": 0.0}, UsageError, "ts must be positive"),
        ({"sampling_spacing": None}, UsageError, "--wall-size"),
    ],
)
def test_a_liu_2020_file_that_does_not_fit_is_refused(tmp_path, changes, error, said):
    variables = {"rect_data": np.ones((3, 4, 5)), "ts": 4e-12, "SPAD_index": [1, 2], "sampling_spacing": 0.01}
    variables |= changes
    matlab(tmp_path / "a.mat", 5, **{name: value for name, value in variables.items() if value is not None})
    with pytest.raises(error, match=said):
        imported(tmp_path / "a.mat")


# --- Lindell 2019


@EXAMPLES
@given(nx=st.integers(2, 4), ny=st.integers(2, 4), data=st.data(), version=st.sampled_from([5, 7.3]))
def test_lindell_2019_subtracts_each_time_of_flight_exactly(tmp_path, nx, ny, data, version):
    i, j, bin_ = (data.draw(st.integers(0, size - 1)) for size in (nx, ny, 6))
    tof_ps = np.random.default_rng(1).uniform(9000, 12000, (nx, ny))
    cube = np.zeros((nx, ny, 6), "u2")
    cube[i, j, bin_] = 3
    matlab(tmp_path / "a.mat", version, meas=cube)
    matlab(tmp_path / "flight.mat", version, tofgrid=tof_ps)
    report, target = imported(
        tmp_path / "a.mat", bin_width_s=32e-12, wall_size_m=2.0, delays=tmp_path / "flight.mat"
    )
    capture, counts = load(target)
    assert (report.layout, report.time_origin) == ("Lindell 2019, f-k", "laser")
    (where,) = np.flatnonzero(counts[:, bin_])
    expected_m = [2 * i / (nx - 1) - 1, 1 - 2 * j / (ny - 1), 0]
    np.testing.assert_allclose(capture.laser_m[where], expected_m, atol=1e-15)
    assert capture.confocal
    assert capture.first_bin_s[where] == pytest.approx(-tof_ps[i, j] * 1e-12, rel=1e-15)


def test_lindell_2019_finds_its_times_of_flight(tmp_path):
    given = {"bin_width_s": 32e-12, "wall_size_m": 2.0}
    matlab(tmp_path / "a.mat", 7.3, meas=np.ones((3, 2, 5), "u2"))
    with pytest.raises(UsageError, match="--tof"):
        imported(tmp_path / "a.mat", **given)
    matlab(tmp_path / "tof.mat", 5, tofgrid=np.full((2, 3), 500.0))
    with pytest.raises(DataFileError, match=r"3 x 2 positions, but tofgrid of tof.mat has shape \(2, 3\)"):
        imported(tmp_path / "a.mat", **given)
    matlab(tmp_path / "tof.mat", 5, tofgrid=np.full((3, 2), 500.0))
    _, target = imported(tmp_path / "a.mat", **given)
    with ScanFile(target) as scan:
        np.testing.assert_allclose(scan.delay_s, 500e-12)
        assert "pulse leaves the laser" in str(scan)
    matlab(tmp_path / "a.mat", 7.3, meas=np.ones((3, 2, 5), "u2"), tofgrid=np.full((3, 2), 700.0))
    _, target = imported(tmp_path / "a.mat", **given)
    with ScanFile(target) as scan:
        np.testing.assert_allclose(scan.delay_s, 700e-12)


def test_a_delay_that_is_no_number_is_refused(tmp_path):
    matlab(tmp_path / "a.mat", 5, meas=np.ones((3, 2, 5), "u2"), tofgrid=np.full((3, 2), 700.0))
    _, target = imported(tmp_path / "a.mat", bin_width_s=32e-12, wall_size_m=2.0)
    with h5py.File(target, "r+") as file:
        file["geometry/delay_s"][4] = np.nan
    with pytest.raises(DataFileError, match="delay that is not a number"):
        ScanFile(target)


def test_lindell_2019_with_a_wall_that_is_not_flat_is_refused(tmp_path):
    matlab(tmp_path / "a.mat", 5, meas=np.ones((3, 2, 5)), pos=np.ones((3, 2, 3)), tofgrid=np.ones((3, 2)))
    with pytest.raises(DataFileError, match="not flat"):
        imported(tmp_path / "a.mat", bin_width_s=32e-12, wall_size_m=2.0)


# --- Z-NLOS


@EXAMPLES
@given(
    colours=SIZES,
    bins=st.integers(5, 7),
    bounces=SIZES,
    nx=SIZES,
    ny=SIZES,
    laser=st.none() | st.tuples(SIZES, SIZES),
    turned=st.booleans(),
)
def test_znlos_keeps_places_times_and_light(tmp_path, colours, bins, bounces, nx, ny, laser, turned):
    shape = (colours, bins, bounces, nx, ny, *(laser or ()))
    wrote = znlos(tmp_path / "a.hdf5", shape, turned)
    try:
        report, target = imported(tmp_path / "a.hdf5")
    except DataFileError as error:
        # only sizes that read the same from both ends may be refused
        assert "both orders" in str(error)  # noqa: PT017
        grids = [wrote[f"{side}GridPositions"].shape for side in ("camera", "laser")]
        assert all(3 in (grid[0], grid[2]) for grid in grids)
        return
    capture, counts = load(target)
    assert report.time_origin == "laser"
    summed = wrote["data"].sum(axis=(0, 2), dtype=float)
    seen = {
        tuple(np.round(wrote["cameraGridPositions"][:, i, j], 6)): (i, j)
        for i in range(nx)
        for j in range(ny)
    }
    lit_shape = laser or (nx, ny)
    lit = {
        tuple(np.round(wrote["laserGridPositions"][:, i, j], 6)): (i, j)
        for i in range(lit_shape[0])
        for j in range(lit_shape[1])
    }
    one_laser = laser is not None and lit_shape == (1, 1)
    for position, row in enumerate(counts):
        ends_m = capture.laser_m[position], capture.detector_m[position if len(capture.detector_m) > 1 else 0]
        # a laser that stands still is our detector
        lit_m, seen_m = ends_m[::-1] if one_laser else ends_m
        place = seen[tuple(np.round(seen_m, 6))]
        at = lit[tuple(np.round(lit_m, 6))]
        expected = summed[:, *place] if laser is None else summed[:, *place, *at]
        np.testing.assert_allclose(row, expected, rtol=1e-6)
        legs_m = np.linalg.norm(lit_m - wrote["laserPosition"]) + np.linalg.norm(
            seen_m - wrote["cameraPosition"]
        )
        first_s = np.broadcast_to(capture.first_bin_s, len(counts))[position]
        assert first_s == pytest.approx((1.2 - legs_m) / C_M_PER_S, abs=1e-20)
    assert len(counts) == nx * ny * (1 if laser is None else laser[0] * laser[1])


def test_znlos_bounces_can_be_chosen(tmp_path):
    wrote = znlos(tmp_path / "a.hdf5", (1, 6, 4, 2, 5), turned=False)
    report, target = imported(tmp_path / "a.hdf5", bounces=(2, 4))
    _, counts = load(target)
    expected = wrote["data"][0, :, [1, 3]].sum(axis=0).reshape(6, -1).T
    np.testing.assert_allclose(counts, expected, rtol=1e-6)
    assert any("bounces 2, 4 of 4" in line for line in report.assumed)
    with pytest.raises(UsageError, match="bounces 1 to 4"):
        imported(tmp_path / "a.hdf5", bounces=(5,))


def test_znlos_that_does_not_fit_is_refused(tmp_path):
    znlos(tmp_path / "a.hdf5", (1, 6, 4, 2, 5), turned=False)
    with h5py.File(tmp_path / "a.hdf5", "r+") as file:
        del file["cameraGridPositions"]
        file["cameraGridPositions"] = np.zeros((3, 5, 2))
    with pytest.raises(DataFileError, match="do not fit together"):
        imported(tmp_path / "a.hdf5")


# --- exhaustive TAL


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("sizes", [((2, 3), (3, 4)), ((2, 3), (1, 1)), ((1, 1), (3, 4))])
@pytest.mark.parametrize("legs", [False, True])
def test_exhaustive_tal_becomes_pairs(tmp_path, flat, sizes, legs):
    (lx, ly), (sx, sy) = sizes
    rng = np.random.default_rng(4)
    signal = rng.random((9, lx, ly, sx, sy)).astype("f4")
    laser_m, sensor_m = (
        np.concatenate([rng.uniform(-1, 1, (*size, 2)), np.zeros((*size, 1))], axis=-1) for size in sizes
    )
    if flat:
        changes = {"H": signal.reshape(9, lx * ly, -1), "H_format": ("HFormat", {"T_Li_Si": 4}, 4)}
        changes |= {"laser_grid_xyz": laser_m.reshape(-1, 3), "sensor_grid_xyz": sensor_m.reshape(-1, 3)}
    else:
        changes = {"H": signal, "H_format": ("HFormat", {"T_Lx_Ly_Sx_Sy": 2}, 2)}
        changes |= {"laser_grid_xyz": laser_m, "sensor_grid_xyz": sensor_m}
    changes["sensor_grid_normals"] = np.broadcast_to([0.0, 0.0, 1.0], changes["sensor_grid_xyz"].shape)
    wrote = tal(tmp_path / "a.hdf5", legs=legs, **changes)
    _, target = imported(tmp_path / "a.hdf5")
    capture, counts = load(target)
    assert len(counts) == lx * ly * sx * sy
    swapped = lx * ly == 1  # by reciprocity
    for position, row in enumerate(counts):
        ends_m = capture.laser_m[position], capture.detector_m[position if len(capture.detector_m) > 1 else 0]
        lit_m, seen_m = ends_m[::-1] if swapped else ends_m
        lit = np.argwhere((laser_m == lit_m).all(axis=-1))
        seen = np.argwhere((sensor_m == seen_m).all(axis=-1))
        np.testing.assert_array_equal(row, signal[:, *lit[0], *seen[0]])
        legs_m = np.linalg.norm(lit_m - wrote["laser_xyz"]) + np.linalg.norm(seen_m - wrote["sensor_xyz"])
        first_s = np.broadcast_to(capture.first_bin_s, len(counts))[position]
        assert first_s == pytest.approx((1.5 - legs * legs_m) / C_M_PER_S, abs=1e-20)


def test_the_command_takes_bounces_and_times_of_flight(rig, tmp_path):
    znlos(tmp_path / "a.hdf5", (1, 6, 4, 2, 5), turned=False)
    assert rig("import", "a.hdf5", "a.h5", "--bounces", "2,3").code == 0
    wrong = rig("import", "a.hdf5", "b.h5", "--bounces", "third")
    assert (wrong.code, "--bounces 2,3" in wrong.err) == (2, True)
    matlab(tmp_path / "m.mat", 5, meas=np.ones((3, 2, 5)))
    matlab(tmp_path / "t.mat", 5, tofgrid=np.ones((3, 2)))
    done = rig("import", "m.mat", "m.h5", "--tof", "t.mat", "--bin-width", "32ps", "--wall-size", "2m")
    assert (done.code, "Lindell" in done.out) == (0, True)
