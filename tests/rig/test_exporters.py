"""What is exported is read back by the library that owns the format, in our frame and units."""

import json

import h5py
import numpy as np
import pytest
import scipy.io

from rig.errors import UsageError
from rig.exporters import export, tal
from rig.files import ScanDescription, ScanFile, ScanWriter, Volume, write_volume
from rig.files.description import MOST_COUNTED
from rig.files.inspection import CHUNK_BYTES
from rig.importers import import_scan
from rig.model.delays import PathDelays
from support.imaged_points import brightest, point_signal
from support.scan_files import C_M_PER_S, load

X_M, Y_M, Z_M = 0.1 * np.arange(5) - 0.3, 0.2 * np.arange(4) - 0.1, 1.0 + 0.05 * np.arange(3)


def volume(path, **changes):
    given = {
        "intensity": np.random.default_rng(3).random((3, 4, 5), "f4"),
        "x_m": X_M,
        "y_m": Y_M,
        "z_m": Z_M,
        "depth_m": np.array([[1.0, np.nan, 1.05, 1.1, 1.0]] * 4, "f4"),
        "parameters": {"wavelength_m": 0.04, "camera": "confocal"},
    } | changes
    write_volume(path, Volume(**given))
    return given


def scan(path, counts, laser_m, detector_m, **changes):
    description = ScanDescription(
        laser_m, detector_m, counts.shape[1], 8e-12, changes.pop("first_bin_s", 2e-9), **changes
    )
    with ScanWriter.create(path, description) as writer:
        for row in counts:
            writer.append(row)


def grid(nx=3, ny=4):
    """Positions of a raster scan: x fastest, every other line backwards."""
    lines = [[(0.1 * i, 0.2 * j, 0.0) for i in range(nx)][:: 1 if j % 2 == 0 else -1] for j in range(ny)]
    return np.array(lines).reshape(-1, 3)


@pytest.mark.parametrize("ending", ["npz", "mat"])
def test_arrays_come_back(tmp_path, ending):
    wrote = volume(tmp_path / "v.h5")
    export(tmp_path / "v.h5", tmp_path / f"v.{ending}")
    if ending == "npz":
        with np.load(tmp_path / "v.npz") as file:
            read = dict(file)
        parameters = str(read["parameters"])
    else:
        read = scipy.io.loadmat(tmp_path / "v.mat")
        parameters = read["parameters"][0]
    for name in ("intensity", "x_m", "y_m", "z_m", "depth_m"):
        np.testing.assert_array_equal(np.squeeze(read[name]), wrote[name])
    assert read["intensity"].dtype == np.float32
    assert json.loads(parameters) == wrote["parameters"]


def test_frames_keep_their_times(tmp_path):
    t_s = np.array([1e-9, 2e-9])
    wrote = volume(tmp_path / "v.h5", intensity=np.random.default_rng(1).random((2, 3, 4, 5), "f4"), t_s=t_s)
    export(tmp_path / "v.h5", tmp_path / "v.npz")
    with np.load(tmp_path / "v.npz") as file:
        np.testing.assert_array_equal(file["intensity"], wrote["intensity"])
        np.testing.assert_array_equal(file["t_s"], t_s)
    with pytest.raises(UsageError, match=r"time axis.*\.npz"):
        export(tmp_path / "v.h5", tmp_path / "v.vti")


def test_vtk_finds_each_voxel_at_its_place(tmp_path):
    vtk_xml = pytest.importorskip("vtkmodules.vtkIOXML", reason="vtk is not installed")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    wrote = volume(tmp_path / "v.h5")
    export(tmp_path / "v.h5", tmp_path / "v.vti")
    reader = vtk_xml.vtkXMLImageDataReader()
    reader.SetFileName(str(tmp_path / "v.vti"))
    reader.Update()
    image = reader.GetOutput()
    values = vtk_to_numpy(image.GetPointData().GetScalars())
    assert image.GetPointData().GetScalars().GetName() == "intensity"
    assert image.GetNumberOfPoints() == 60
    for k, z in enumerate(Z_M):
        for j, y in enumerate(Y_M):
            for i, x in enumerate(X_M):
                point = image.FindPoint(x, y, z)
                np.testing.assert_allclose(image.GetPoint(point), (x, y, z), atol=1e-12)
                assert values[point] == wrote["intensity"][k, j, i]


def test_tiff_pages_are_the_planes_as_the_camera_sees_them(tmp_path):
    tifffile = pytest.importorskip("tifffile", reason="tifffile is not installed")
    wrote = volume(tmp_path / "v.h5")
    export(tmp_path / "v.h5", tmp_path / "v.tif")
    with tifffile.TiffFile(tmp_path / "v.tif") as file:
        assert file.is_imagej
        pages = file.asarray()
        assert file.imagej_metadata["spacing"] == pytest.approx(0.05)
        assert file.imagej_metadata["unit"] == "m"
        tags = file.pages[0].tags
        assert np.divide(*tags["XResolution"].value) == pytest.approx(10)
        assert np.divide(*tags["YResolution"].value) == pytest.approx(5)
    assert pages.dtype == np.float32
    # top row: greatest y; leftmost column: greatest x, since x grows to the camera's left
    np.testing.assert_array_equal(pages, wrote["intensity"][:, ::-1, ::-1])


@pytest.mark.parametrize("ending", ["vti", "tif"])
def test_uneven_axes_are_refused_where_only_a_spacing_is_kept(tmp_path, ending):
    volume(tmp_path / "v.h5", z_m=np.array([1.0, 1.1, 1.3]))
    with pytest.raises(UsageError, match=r"z_m is not evenly spaced.*\.npz"):
        export(tmp_path / "v.h5", tmp_path / f"v.{ending}")
    assert not list(tmp_path.glob(f"*.{ending}"))


@pytest.mark.parametrize(
    "legs", [None, PathDelays(np.array([0.3, 0.2, 2.0]), np.array([-0.4, 0.1, 2.5]), 3e-9)]
)
@pytest.mark.parametrize("confocal", [False, True])
@pytest.mark.parametrize("full", [True, False])
def test_tal_goes_round(tmp_path, confocal, full, legs):
    """Out as TAL and in again: the same photons at the same places and rectified times."""
    laser_m = grid()[: None if full else 11]
    counts = np.random.default_rng(6).poisson(3.0, (len(laser_m), 20)).astype("u4")
    detector_m = laser_m if confocal else np.array([[0.05, 0.1, 0.0]])
    scan(tmp_path / "a.h5", counts, laser_m, detector_m, delays=legs)
    export(tmp_path / "a.h5", tmp_path / "a.hdf5")
    with h5py.File(tmp_path / "a.hdf5") as file:
        assert h5py.check_enum_dtype(file["H_format"].dtype)["T_Sx_Sy"] == 1
        assert file["H_format"][0] == (1 if full else 3)
        assert file["H"].shape == ((20, 3, 4) if full else (20, 11))
        assert file["H"].shape[1:] == file["sensor_grid_xyz"].shape[:-1]
        assert file["delta_t"][()] == pytest.approx(8e-12 * C_M_PER_S, rel=1e-15)
    import_scan(tmp_path / "a.hdf5", tmp_path / "b.h5")
    (before, sent), (after, got) = load(tmp_path / "a.h5"), load(tmp_path / "b.h5")
    first_s = [np.broadcast_to(capture.first_bin_s, len(laser_m)) for capture in (before, after)]
    by_place = [np.lexsort(capture.laser_m[:, :2].T) for capture in (before, after)]
    np.testing.assert_array_equal(sent[by_place[0]], got[by_place[1]])
    np.testing.assert_allclose(before.laser_m[by_place[0]], after.laser_m[by_place[1]], atol=1e-15)
    # delays of tens of nanoseconds, in double precision
    np.testing.assert_allclose(first_s[0][by_place[0]], first_s[1][by_place[1]], atol=1e-22)
    assert after.confocal == confocal
    if not confocal:
        np.testing.assert_allclose(after.detector_m, detector_m, atol=1e-15)


def test_tal_in_parts_is_tal_in_one(tmp_path):
    counts = np.random.default_rng(6).poisson(3.0, (12, 20)).astype("u4")
    scan(tmp_path / "a.h5", counts, grid(), np.zeros((1, 3)))
    export(tmp_path / "a.h5", tmp_path / "one.hdf5")
    with ScanFile(tmp_path / "a.h5") as source:
        tal.write(tmp_path / "parts.hdf5", source, part_bytes=12 * 4 * 7)  # 7, 7 and 6 bins
    with h5py.File(tmp_path / "one.hdf5") as one, h5py.File(tmp_path / "parts.hdf5") as parts:
        np.testing.assert_array_equal(one["H"][()], parts["H"][()])
        assert one["H"][()].sum() == counts.sum()


def test_tal_of_any_number_of_positions_has_chunks_that_are_read():
    for positions in (1, 23_400, 2**20, 2**20 + 1, MOST_COUNTED):
        assert 4 * positions * tal.bins_of_a_chunk(positions, part=16) <= CHUNK_BYTES
    assert tal.bins_of_a_chunk(2**20, part=16) == 16
    assert tal.bins_of_a_chunk(2**20, part=3) == 3


def test_pairs_have_no_tal_form_but_go_to_matlab(tmp_path):
    laser_m = grid()
    counts = np.random.default_rng(6).poisson(3.0, (12, 20)).astype("u4")
    scan(tmp_path / "a.h5", counts, laser_m, laser_m[::-1], first_bin_s=-1e-9)
    with pytest.raises(UsageError, match=r"pairs.*\.mat"):
        export(tmp_path / "a.h5", tmp_path / "a.hdf5")
    export(tmp_path / "a.h5", tmp_path / "a.mat")
    read = scipy.io.loadmat(tmp_path / "a.mat")
    np.testing.assert_array_equal(read["counts"], counts)
    np.testing.assert_array_equal(read["laser_m"], laser_m)
    np.testing.assert_array_equal(read["detector_m"], laser_m[::-1])
    assert (read["bin_width_s"].item(), read["first_bin_s"].item()) == (8e-12, -1e-9)


def test_measured_delays_go_to_matlab_only(tmp_path):
    counts = np.random.default_rng(6).poisson(3.0, (12, 20)).astype("u4")
    delay_s = np.linspace(9e-9, 12e-9, 12)
    scan(tmp_path / "a.h5", counts, grid(), np.zeros((1, 3)), delay_s=delay_s)
    with pytest.raises(UsageError, match=r"delay for each position.*\.mat"):
        export(tmp_path / "a.h5", tmp_path / "a.hdf5")
    export(tmp_path / "a.h5", tmp_path / "a.mat")
    read = scipy.io.loadmat(tmp_path / "a.mat")
    np.testing.assert_allclose(read["first_bin_s"].ravel(), 2e-9 - delay_s, rtol=1e-15)


def test_one_plane_is_a_volume_too(tmp_path):
    vtk_xml = pytest.importorskip("vtkmodules.vtkIOXML", reason="vtk is not installed")
    volume(tmp_path / "v.h5", intensity=np.ones((1, 4, 5), "f4"), z_m=np.array([1.3]))
    export(tmp_path / "v.h5", tmp_path / "v.vti")
    reader = vtk_xml.vtkXMLImageDataReader()
    reader.SetFileName(str(tmp_path / "v.vti"))
    reader.Update()
    assert reader.GetOutput().GetDimensions() == (5, 4, 1)
    assert reader.GetOutput().GetOrigin() == pytest.approx((-0.3, -0.1, 1.3))


def test_the_command_names_the_layout_and_leaves_nothing_half_done(rig, tmp_path):
    volume(tmp_path / "v.h5")
    done = rig("export", "v.h5", "v.npz", "--json")
    assert (done.code, json.loads(done.out)["layout"]) == (0, "NumPy archive")
    again = rig("export", "v.h5", "v.npz")
    assert (again.code, "not overwritten" in again.err) == (2, True)
    unknown = rig("export", "v.h5", "v.stl")
    assert unknown.code == 2
    for ending in (".npz", ".mat", ".vti", ".tif"):
        assert ending in unknown.err
    (tmp_path / "broken.h5").write_bytes(b"nothing")
    assert rig("export", "broken.h5", "b.npz").code == 5
    assert rig("export", "v.h5", "nowhere/v.npz").code == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["broken.h5", "v.h5", "v.npz"]


# --- rectified time


def delayed(path, delay_bins, **changes):
    """A scan in the laser's time whose positions have delays of so many bins; return its counts."""
    counts = np.random.default_rng(6).poisson(3.0, (12, 40)).astype("u4")
    counts[:, :5] = counts[:, -2:] = 0  # nothing is cut off by what is subtracted, nor shared past the end
    delay_s = 2e-9 + np.asarray(delay_bins) * 8e-12
    scan(path, counts, grid(), np.zeros((1, 3)), delay_s=delay_s, **changes)
    return counts


def test_rectified_by_whole_bins_keeps_every_count(tmp_path):
    shift = np.arange(12) % 5
    counts = delayed(tmp_path / "a.h5", shift)
    export(tmp_path / "a.h5", tmp_path / "a.mat", rectify=True)
    read = scipy.io.loadmat(tmp_path / "a.mat")
    assert read["counts"].dtype == np.uint32
    assert read["first_bin_s"].tolist() == [[0.0]]
    for row, moved, sent in zip(read["counts"], shift, counts, strict=True):
        np.testing.assert_array_equal(row[: 40 - moved], sent[moved:])
        assert row.sum() == sent.sum()


def test_rectified_by_parts_of_a_bin_keeps_totals_and_mean_times(tmp_path):
    shift = np.linspace(-3.3, 4.7, 12)
    counts = delayed(tmp_path / "a.h5", shift)
    export(tmp_path / "a.h5", tmp_path / "a.mat", rectify=True)
    signal = scipy.io.loadmat(tmp_path / "a.mat")["counts"]
    assert signal.dtype == np.float32
    assert signal.shape == (12, 44)
    # sums of some tens of counts in single precision
    np.testing.assert_allclose(signal.sum(axis=1), counts.sum(axis=1), rtol=1e-6)
    before, after = (
        (block * np.arange(block.shape[1])).sum(axis=1) / block.sum(axis=1) for block in (counts, signal)
    )
    np.testing.assert_allclose(after, before - shift, atol=1e-5)


@pytest.mark.parametrize("full", [True, False])
def test_a_rectified_scan_goes_to_tal_and_is_imaged_at_the_same_place(rig, tmp_path, full):
    x_m, y_m = np.meshgrid(0.04 * (np.arange(16) - 7.5), 0.04 * (np.arange(16) - 7.5), indexing="ij")
    laser_m = np.stack([x_m, y_m, 0 * x_m], axis=-1).reshape(-1, 3)[: None if full else 250]
    detector_m, point_m = np.array([[0.05, -0.02, 0.0]]), np.array([0.1, -0.06, 0.6])
    legs = PathDelays(np.array([0.3, 0.2, 2.0]), np.array([-0.4, 0.1, 2.5]), 3e-9)
    first_bin_s = 15e-9 - legs.delay_s(laser_m, detector_m)
    counts = point_signal(point_m, laser_m, detector_m, 1300, 8e-12, first_bin_s)
    scan(tmp_path / "a.h5", counts.astype("u4"), laser_m, detector_m, delays=legs, first_bin_s=15e-9)
    assert rig("export", "a.h5", "a.hdf5", "--rectified").code == 0
    with h5py.File(tmp_path / "a.hdf5") as file:
        assert not file["t_accounts_first_and_last_bounces"][()]
        assert file["t_start"][()] == 0
        assert not file["sensor_xyz"][()].any()
    assert rig("import", "a.hdf5", "b.h5").code == 0
    capture, _ = load(tmp_path / "b.h5")
    assert capture.first_bin_s.tolist() == [0.0]
    around = ("--wavelength", "12cm", "--depth", "0.5m:0.7m:1cm")
    # a voxel across and one along z
    assert (np.abs(brightest(rig, "b.h5", *around) - point_m) < [0.041, 0.041, 0.011]).all()


def test_what_cannot_be_rectified_is_refused(rig, tmp_path):
    volume(tmp_path / "v.h5")
    done = rig("export", "v.h5", "v.npz", "--rectified")
    assert (done.code, "--rectified is for scans" in done.err) == (2, True)
    delayed(tmp_path / "a.h5", np.full(12, 1000.0))
    done = rig("export", "a.h5", "a.mat", "--rectified")
    assert (done.code, "nothing is left" in done.err) == (2, True)
    assert not (tmp_path / "a.mat").exists()
