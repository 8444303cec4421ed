"""Layouts of other programs: a hidden point that each holds is imaged where it is."""

import h5py
import numpy as np
import pytest
import scipy.io

from rig.errors import DataFileError, UsageError
from rig.files import ScanFile
from rig.importers import import_scan
from support.imaged_points import brightest, point_signal
from support.layout_files import matlab
from support.scan_files import C_M_PER_S, load

COUNT = 16
POINT_M = np.array([0.1, -0.06, 0.6])
#: Within this of the point: a voxel across, and one along z.
WITHIN_M = np.array([0.041, 0.041, 0.011])
AROUND = ("--wavelength", "16cm", "--depth", "0.5m:0.7m:1cm")
BINS, BIN_S = 400, 16e-12


def grid_m(y_down, count=COUNT):
    """(n n, 3) spots of a square of 60 cm, the second index fastest; x rising."""
    axis_m = 0.04 * (np.arange(count) - (count - 1) / 2)
    x_m, y_m = np.meshgrid(axis_m, axis_m[::-1] if y_down else axis_m, indexing="ij")
    return np.column_stack([x_m.ravel(), y_m.ravel(), np.zeros(x_m.size)])


def confocal_cube(y_down=True):
    spots_m = grid_m(y_down)
    return point_signal(POINT_M, spots_m, spots_m, BINS, BIN_S).reshape(COUNT, COUNT, BINS)


def found(rig, source, *given):
    done = rig("import", source, "scan.h5", *given)
    assert done.code == 0, done.err
    return np.abs(brightest(rig, "scan.h5", *AROUND) - POINT_M)


# --- aligned f-k, and cubes of the other layouts in both versions of MATLAB


@pytest.mark.parametrize("version", [5, 7.3])
@pytest.mark.parametrize("name", ["final_meas", "measlr"])
def test_an_aligned_fk_scan(rig, tmp_path, name, version):
    matlab(tmp_path / "a.mat", version, **{name: confocal_cube()})
    with pytest.raises(UsageError, match=r"--bin-width.*32ps"):
        import_scan(tmp_path / "a.mat", tmp_path / "b.h5")
    with pytest.raises(UsageError, match=r"--wall-size.*2m"):
        import_scan(tmp_path / "a.mat", tmp_path / "b.h5", bin_width_s=BIN_S)
    assert (found(rig, "a.mat", "--bin-width", "16ps", "--wall-size", "60cm") < WITHIN_M).all()


def test_two_aligned_scans_in_one_file_are_refused(tmp_path):
    matlab(tmp_path / "a.mat", 5, final_meas=confocal_cube(), measlr=confocal_cube())
    with pytest.raises(DataFileError, match="both final_meas and measlr"):
        import_scan(tmp_path / "a.mat", tmp_path / "b.h5", bin_width_s=BIN_S, wall_size_m=0.6)


@pytest.mark.parametrize(
    ("variables", "given"),
    [
        ({"rect_data": None, "width": 0.3}, {"bin_width_s": BIN_S}),
        ({"sig": None}, {"bin_width_s": BIN_S, "wall_size_m": 0.6}),
        ({"sig_in": None, "width": 0.3, "timeRes": BIN_S}, {}),
    ],
)
def test_cubes_are_the_same_from_both_versions_of_matlab(tmp_path, variables, given):
    cube = np.random.default_rng(2).poisson(1.0, (3, 4, 9)).astype("u2")
    variables = {name: cube if value is None else value for name, value in variables.items()}
    for version in (5, 7.3):
        matlab(tmp_path / f"{version}.mat", version, **variables)
        import_scan(tmp_path / f"{version}.mat", tmp_path / f"{version}.h5", **given)
    (one, counts), (other, others) = (load(tmp_path / f"{version}.h5") for version in (5, 7.3))
    np.testing.assert_array_equal(counts, others)
    np.testing.assert_array_equal(counts, cube.reshape(12, 9))
    np.testing.assert_array_equal(one.laser_m, other.laser_m)


# --- D-LCT


@pytest.mark.parametrize("form", ["struct", "fields", "fields v7.3", "struct v7.3"])
def test_the_struct_of_dlct(rig, tmp_path, form):
    fields = {"Data": confocal_cube().astype(float), "DeltaT": BIN_S * C_M_PER_S, "CameraGridSize": 0.6}
    if form == "struct":
        scipy.io.savemat(tmp_path / "a.mat", {"nlos": fields | {"Depth": np.nan}})
    elif form == "struct v7.3":
        with h5py.File(tmp_path / "a.mat", "w") as file:
            for name, value in fields.items():
                file[f"nlos/{name}"] = np.atleast_2d(value).T
    else:
        matlab(tmp_path / "a.mat", 5 if form == "fields" else 7.3, **fields)
    assert (found(rig, "a.mat") < WITHIN_M).all()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"DeltaT": 0.0}, "DeltaT must be positive"),
        ({"CameraGridSize": [0.6, 0.7]}, "side of a square"),
        ({"Data": np.ones((4, 5))}, r"\(4, 5\)"),
        ({"Data": "none"}, "not real numbers"),
        ({"CameraGridSize": None}, "lacks 'nlos/CameraGridSize'"),
    ],
)
def test_a_struct_of_dlct_that_does_not_fit_is_refused(tmp_path, changes, said):
    fields = {"Data": np.ones((4, 4, 5)), "DeltaT": 0.005, "CameraGridSize": 0.6} | changes
    scipy.io.savemat(tmp_path / "a.mat", {"nlos": {k: v for k, v in fields.items() if v is not None}})
    with pytest.raises((DataFileError, UsageError), match=said):
        import_scan(tmp_path / "a.mat", tmp_path / "b.h5")


# --- DIRAC


def dirac(path, offset, **changes):
    spots_m = grid_m(y_down=False)
    variables = {
        "data_t": np.moveaxis(confocal_cube(y_down=False), 2, 0).astype("f4"),
        "xg": spots_m[:, 0].reshape(COUNT, COUNT),
        "yg": spots_m[:, 1].reshape(COUNT, COUNT),
        "xa": spots_m[::COUNT, 0],
        "ya": spots_m[:COUNT, 1],
        "da": np.arange(BINS) * BIN_S * C_M_PER_S,
        "offset_laser": np.array([[offset]]),
    } | changes
    with h5py.File(path, "w") as file:
        for name, value in variables.items():
            file[name] = value


def test_dirac_whose_offsets_are_subtracted(rig, tmp_path):
    dirac(tmp_path / "a.hdf5", 1.7)
    assert (found(rig, "a.hdf5") < WITHIN_M).all()


def test_dirac_without_an_offset_is_asked_for_its_time_origin(rig, tmp_path):
    dirac(tmp_path / "a.hdf5", 0.0)
    asked = rig("import", "a.hdf5", "scan.h5")
    assert (asked.code, "--time-origin wall if not" in asked.err) == (2, True)
    laser = rig("import", "a.hdf5", "scan.h5", "--time-origin", "laser")
    assert (laser.code, "--tof" in laser.err) == (2, True)
    assert (found(rig, "a.hdf5", "--time-origin", "wall") < WITHIN_M).all()


def test_dirac_with_its_legs_and_times_of_flight(rig, tmp_path):
    flight_ps = np.random.default_rng(4).uniform(500, 900, (COUNT, COUNT))
    spots_m = grid_m(y_down=False)
    signal = point_signal(POINT_M, spots_m, spots_m, BINS, BIN_S, -flight_ps.ravel() * 1e-12)
    dirac(tmp_path / "a.hdf5", 0.0, data_t=signal.T.reshape(BINS, COUNT, COUNT).astype("f4"))
    matlab(tmp_path / "tof.mat", 5, tofgrid=flight_ps)
    assert (found(rig, "a.hdf5", "--time-origin", "laser", "--tof", "tof.mat") < WITHIN_M).all()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"da": np.arange(BINS) ** 2 * 1.0}, "not evenly spaced"),
        ({"xg": np.zeros((COUNT, COUNT + 1)), "yg": np.zeros((COUNT, COUNT + 1))}, "data_t has shape"),
    ],
)
def test_a_dirac_file_that_does_not_fit_is_refused(tmp_path, changes, said):
    dirac(tmp_path / "a.hdf5", 1.0, **changes)
    with pytest.raises(DataFileError, match=said):
        import_scan(tmp_path / "a.hdf5", tmp_path / "b.h5")


# --- 3D-RSD, in both of its forms


def curved_m(count=COUNT):
    spots_m = grid_m(y_down=False, count=count)
    spots_m[:, 2] = 0.2 * spots_m[:, 0] ** 2 - 0.03
    return spots_m


DETECTOR_M = np.array([[0.075, 0.142, -0.05]])


@pytest.mark.parametrize("version", [5, 7.3])
@pytest.mark.parametrize("name", ["laser_pos_base", "laser_pos"])
def test_a_raw_scene_of_3d_rsd(rig, tmp_path, name, version):
    signal = point_signal(POINT_M, curved_m(), DETECTOR_M, BINS, BIN_S)
    detector = {name: DETECTOR_M.reshape(1, 1, 3)} if version == 5 else {name: DETECTOR_M}
    places = {"camera_pos": curved_m(), "ts": BIN_S} | detector
    matlab(tmp_path / "scene_0_raw.mat", version, total_rect_data=signal, **places)
    assert (found(rig, "scene_0_raw.mat") < WITHIN_M).all()
    capture, _ = load(tmp_path / "scan.h5")
    np.testing.assert_allclose(capture.laser_m, curved_m(), atol=1e-12)
    np.testing.assert_allclose(capture.detector_m, DETECTOR_M, atol=1e-12)


def test_a_raw_scene_with_several_detector_spots_is_refused(tmp_path):
    places = {"camera_pos": curved_m(), "ts": BIN_S, "laser_pos": np.ones((3, 3))}
    matlab(tmp_path / "a.mat", 5, total_rect_data=np.ones((COUNT**2, 5)), **places)
    with pytest.raises(DataFileError, match="3 of laser_pos"):
        import_scan(tmp_path / "a.mat", tmp_path / "b.h5")


@pytest.mark.parametrize("flat", [False, True])
def test_data_finds_the_setup_of_its_own_name(rig, tmp_path, flat):
    shape = (COUNT**2,) if flat else (COUNT, COUNT)
    signal = point_signal(POINT_M, curved_m(), DETECTOR_M, BINS, BIN_S)
    seen_m = np.broadcast_to(DETECTOR_M, (COUNT**2, 3))
    matlab(tmp_path / "data_0.mat", 5, data=signal.reshape(*shape, BINS))
    for name, lit_m in (("setup_0.mat", curved_m()), ("setup.mat", curved_m() + 5.0)):
        places = {"laserpoints": lit_m.reshape(*shape, 3), "detectpoints": seen_m.reshape(*shape, 3)}
        matlab(tmp_path / name, 5, **places)
    assert (found(rig, "data_0.mat", "--bin-width", "16ps") < WITHIN_M).all()


def test_data_with_times_of_flight_is_rectified_by_them(rig, tmp_path):
    flight_ps = np.random.default_rng(4).uniform(500, 900, (COUNT, COUNT))
    signal = point_signal(POINT_M, curved_m(), DETECTOR_M, BINS, BIN_S, -flight_ps.ravel() * 1e-12)
    seen_m = np.broadcast_to(DETECTOR_M, (COUNT**2, 3))
    matlab(tmp_path / "data.mat", 5, data=signal.reshape(COUNT, COUNT, BINS))
    places = {"laserpoints": curved_m(), "detectpoints": seen_m}
    matlab(tmp_path / "setup.mat", 5, **{name: at.reshape(COUNT, COUNT, 3) for name, at in places.items()})
    matlab(tmp_path / "flight.mat", 5, tofgrid=flight_ps)
    matlab(tmp_path / "short.mat", 5, tofgrid=flight_ps[:3])
    short = rig("import", "data.mat", "b.h5", "--bin-width", "16ps", "--tof", "short.mat")
    assert (short.code, "48 times of flight, but there are 256 positions" in short.err) == (5, True)
    assert (found(rig, "data.mat", "--bin-width", "16ps", "--tof", "flight.mat") < WITHIN_M).all()


# --- CMU


@pytest.mark.parametrize("cleared", [0, 100])
def test_a_transient_of_cmu_has_its_y_downwards(rig, tmp_path, cleared):
    spots_m = grid_m(y_down=False)
    signal = point_signal(POINT_M, spots_m, spots_m, BINS, BIN_S)
    if cleared:  # background after the wall's own light, which was cleared
        signal[:, cleared:] += np.random.default_rng(1).poisson(0.5, (COUNT**2, BINS - cleared)).astype("u2")
    matlab(tmp_path / "a.mat", 5, transient=signal, lighting=spots_m * [1, -1, 1])
    assert "4ps" in rig("import", "a.mat", "scan.h5").err
    assert (found(rig, "a.mat", "--bin-width", "16ps") < WITHIN_M).all()
    with ScanFile(tmp_path / "scan.h5") as scan:
        assert scan.fade_from_s == (pytest.approx(cleared * BIN_S) if cleared else None)


def test_a_simulated_transient_of_cmu_says_its_bins_and_sensor(rig, tmp_path):
    spots_m = grid_m(y_down=False)
    signal = point_signal(POINT_M, spots_m, DETECTOR_M, BINS, BIN_S) * 0.5
    seen_m = np.broadcast_to(DETECTOR_M, spots_m.shape)
    variables = {"gt_transient": signal, "lighting": spots_m, "sensor": seen_m}
    matlab(tmp_path / "a.mat", 5, bin_width=BIN_S * C_M_PER_S, **variables)
    assert (found(rig, "a.mat", "--fade-from", "1ns") < WITHIN_M).all()
    capture, _ = load(tmp_path / "scan.h5")
    np.testing.assert_allclose(capture.detector_m, DETECTOR_M, atol=1e-12)


# --- general-NLOS as measured


def raw(folder, lit_m, seen_m, in_one=True, more=0):
    """Write a raw capture: first bounce and hidden point in each record, lines to and fro."""
    head_m = np.array([0.1, -0.2, 1.5])
    first = [np.rint(2 * np.linalg.norm(one - head_m, axis=1) / C_M_PER_S / BIN_S) for one in (lit_m, seen_m)]
    delay_s = ((first[0] + first[1]) / 2 + 0.5) * BIN_S
    signal = point_signal(POINT_M, lit_m, seen_m, 1200, BIN_S, -delay_s).astype("i4")
    for row, at in zip(signal, np.floor(delay_s / BIN_S).astype(int), strict=True):
        row[at : at + 30] += np.geomspace(5000, 5, 30).astype(int)
    lines = signal.reshape(COUNT, COUNT, 1200)
    lines[1::2] = lines[1::2, ::-1].copy()
    matlab(folder / "data_raw.mat", 5, counts=np.concatenate([signal, np.ones((more, 1200), "i4")]))
    for number, peak in enumerate(first, 1):
        matlab(folder / f"peak{number}.mat", 5, **{f"peak{number}": peak.reshape(COUNT, COUNT)})
    places = {"laserpoints": lit_m.reshape(COUNT, COUNT, 3), "detectpoints": seen_m.reshape(COUNT, COUNT, 3)}
    if in_one:
        matlab(folder / "setup.mat", 5, **places)
    else:
        for name, at_m in places.items():
            matlab(folder / f"{name}.mat", 5, **{name: at_m})
    return delay_s


@pytest.mark.parametrize("in_one", [True, False])
def test_a_raw_capture_has_a_delay_for_each_position(rig, tmp_path, in_one):
    seen_m = curved_m() + np.array([0.05, 0.02, 0.0])
    delay_s = raw(tmp_path, curved_m(), seen_m, in_one, more=7)
    assert (found(rig, "data_raw.mat", "--bin-width", "16ps") < WITHIN_M).all()
    with ScanFile(tmp_path / "scan.h5") as scan:
        np.testing.assert_allclose(scan.delay_s[:, 0], delay_s, rtol=1e-12)
        assert scan.fade_from_s == 1.28e-9
        assert any("7 records after the last pair" in line for line in scan.imported["assumed"])


def test_a_raw_capture_without_its_peaks_is_told_what_it_lacks(tmp_path):
    raw(tmp_path, curved_m(), curved_m())
    (tmp_path / "peak2.mat").unlink()
    with pytest.raises(DataFileError, match=r"like general-NLOS, raw, but lacks peak2\.mat"):
        import_scan(tmp_path / "data_raw.mat", tmp_path / "b.h5", bin_width_s=BIN_S)
    matlab(tmp_path / "peak2.mat", 5, peak2=np.ones((3, 3)))
    with pytest.raises(DataFileError, match="one of each a pair is needed"):
        import_scan(tmp_path / "data_raw.mat", tmp_path / "b.h5", bin_width_s=BIN_S)


# --- both versions of MATLAB


@pytest.mark.parametrize("layout", ["cc_socr", "setup", "cmu", "raw"])
def test_pairs_are_the_same_from_both_versions_of_matlab(tmp_path, layout):
    count = 4
    lit_m, seen_m = curved_m(count), curved_m(count) + np.array([0.03, 0.01, 0.02])
    signal = np.random.default_rng(2).poisson(3.0, (count**2, 9)).astype("u2") + 1
    index = np.array([[x % 3, x, y] for x in range(count) for y in range(count)])
    places = {"laserpoints": lit_m.reshape(count, count, 3), "detectpoints": seen_m.reshape(count, count, 3)}
    peak = np.arange(16.0).reshape(count, count)
    files, given = {
        "cc_socr": (
            {"a": {"sub_Sig": signal}, "C_i": {"C_i": index}, "C_d": {"C_d": index[::-1]}},
            {"bin_width_s": BIN_S, "wall_size_m": 0.3, "depth_pitch_m": 0.01},
        ),
        "setup": (
            {"a": {"data": signal.reshape(count, count, 9)}, "setup": places},
            {"bin_width_s": BIN_S},
        ),
        "cmu": ({"a": {"transient": signal, "lighting": lit_m, "sensor": seen_m}}, {"bin_width_s": BIN_S}),
        "raw": (
            {"a": {"counts": signal}, "setup": places, "peak1": {"peak1": peak}, "peak2": {"peak2": peak}},
            {"bin_width_s": BIN_S, "fade_from_s": 1e-11},
        ),
    }[layout]
    read = []
    for version in (5, 7.3):
        (tmp_path / str(version)).mkdir()
        for name, variables in files.items():
            matlab(tmp_path / str(version) / f"{name}.mat", version, **variables)
        import_scan(tmp_path / str(version) / "a.mat", tmp_path / f"{version}.h5", **given)
        capture, counts = load(tmp_path / f"{version}.h5")
        read.append((counts, capture.laser_m, capture.detector_m, capture.first_bin_s))
    for one, other in zip(*read, strict=True):
        np.testing.assert_array_equal(one, other)
    if layout in {"setup", "raw"}:
        np.testing.assert_allclose(read[0][1], lit_m)
        np.testing.assert_allclose(read[0][2], seen_m)
