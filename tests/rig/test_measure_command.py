"""``rig measure``: truths of every kind say the same, and the document holds what was put into the image."""

import json

import h5py
import numpy as np
import pytest

from rig.errors import DataFileError, UsageError
from rig.files import ScanDescription, ScanWriter, Volume, read_volume, write_volume
from rig.image.measures import measure, wall_of
from rig.image.truth import true_depth
from rig.importers import import_scan
from support.published import published

X_M, Y_M, Z_M = np.arange(-20, 21) * 0.02, np.arange(-15, 16) * 0.02, np.arange(40, 80) * 0.02
#: A rectangle at 1.2 m, x from -0.1 to 0.3, y from -0.2 to 0.1: 20 x 15 pixels of 2 cm, none on its edge.
CORNERS_M = np.array([[-0.11, -0.21, 1.2], [0.29, -0.21, 1.2], [0.29, 0.09, 1.2], [-0.11, 0.09, 1.2]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def rectangle():
    inside = (X_M > -0.11) & (X_M < 0.29) & ((Y_M > -0.21) & (Y_M < 0.09))[:, None]
    return np.where(inside, 1.2, np.nan)


def volume(depth_error_m=0.004, **changes):
    """An image of the rectangle, a little too deep, on a background of 1 %."""
    along = np.exp(-(((Z_M - 1.2 - depth_error_m) / 0.05) ** 2))
    across = np.where(
        np.isfinite(rectangle()), 1.0, 0.01 * np.random.default_rng(2).random(rectangle().shape)
    )
    given = {
        # the solver's fall-off within the pulse
        "intensity": (along[:, None, None] * across / Z_M[:, None, None] ** 2).astype("f4"),
        "x_m": X_M,
        "y_m": Y_M,
        "z_m": Z_M,
        "parameters": {"wavelength_m": 0.04, "cycles": 6.0},
    } | changes
    return Volume(**given)


def write_truth(kind, path):
    depth_m = rectangle()
    if kind == "map.npz":
        np.savez(path, depth_m=depth_m, x_m=X_M, y_m=Y_M)
    elif kind == "voxels.npz":
        occupied = np.isfinite(depth_m) & (np.abs(Z_M - 1.2) < 0.001)[:, None, None]
        np.savez(path, occupied=occupied, x_m=X_M, y_m=Y_M, z_m=Z_M)
    elif kind == "volume.h5":
        write_volume(path, volume(depth_m=depth_m.astype("f4")))
    elif kind == "meshes.h5":
        with h5py.File(path, "w") as file:
            file["truth/geometry/plate/vertices_m"], file["truth/geometry/plate/faces"] = CORNERS_M, FACES
    else:
        trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
        trimesh.Trimesh(CORNERS_M, FACES).export(path)


@pytest.mark.parametrize(
    "kind", ["map.npz", "voxels.npz", "volume.h5", "meshes.h5", "plate.obj", "plate.ply", "plate.stl"]
)
def test_every_kind_of_truth_says_the_same(rig, tmp_path, kind):
    write_volume(tmp_path / "v.h5", volume())
    write_truth(kind, tmp_path / kind)
    done = rig("measure", "v.h5", "--truth", kind, "--threshold", "0.05", "--json")
    assert done.code == 0, done.err
    found = json.loads(done.out)
    assert found["overlap"] == 1
    assert found["pixels_seen"] == found["depth"]["pixels"] == 300
    # single precision of the intensity's logarithm
    assert found["depth"]["median_m"] == pytest.approx(0.004, abs=1e-4)
    assert found["depth"]["rms_m"] == pytest.approx(0.004, abs=1e-4)
    assert found["depth"]["close"] == 1
    assert found["contrast"] == pytest.approx((1 - 0.005) / (1 + 0.005), rel=0.01)


def test_a_threshold_decides_what_is_seen():
    # the rectangle's depth is its brightest plane, 1.2 m; half of it is fainter
    dim = volume()
    dim.intensity[:, :, X_M < 0.1] *= 0.3
    assert measure(dim, rectangle(), threshold=0.5).document["overlap"] == pytest.approx(10 / 20)
    assert measure(dim, rectangle(), threshold=0.1).document["overlap"] == 1
    nothing = np.full(rectangle().shape, np.nan, "f4")
    as_imaged = measure(volume(depth_m=nothing), rectangle()).document
    assert (as_imaged["overlap"], as_imaged["depth"]["median_m"]) == (0, None)


def scan(path, confocal):
    laser_m = np.array([[x, y, 0.0] for y in (-0.65, 0.65) for x in (-0.9, 0.9)])
    description = ScanDescription(laser_m, laser_m if confocal else laser_m[:1], 5, 4e-12, 0.0)
    with ScanWriter.create(path, description) as writer:
        for _ in laser_m:
            writer.append(np.zeros(5, "u4"))


@pytest.mark.parametrize("confocal", [False, True])
def test_theory_takes_its_wall_from_the_scan(rig, tmp_path, confocal):
    scan(tmp_path / "s.h5", confocal)
    write_volume(tmp_path / "v.h5", volume())
    without = json.loads(rig("measure", "v.h5", "--json").out)
    assert without["widths"]["x"]["theory"] == {}
    found = json.loads(rig("measure", "v.h5", "--scan", "s.h5", "--json").out)["widths"]
    z_m = 1.2  # the brightest plane
    for axis, d_m in (("x", 1.8), ("y", 1.3)):
        theory = found[axis]["theory"]
        assert theory["paraxial_m"] == pytest.approx((0.61 if confocal else 1.22) * 0.04 * z_m / d_m)
        sine = d_m / 2 / np.hypot(d_m / 2, z_m)
        assert theory["rayleigh_m"] == pytest.approx(1.22 * 0.04 / ((4 if confocal else 2) * sine))
    assert found["x"]["fwhm_m"] == pytest.approx(0.4, abs=0.02)
    assert found["y"]["fwhm_m"] == pytest.approx(0.3, abs=0.02)


def test_only_its_own_scan_beside_a_volume_is_its_wall(tmp_path):
    from rig.files import ScanFile

    scan(tmp_path / "s.h5", False)
    with ScanFile(tmp_path / "s.h5") as file:
        digest = file.digest
    own = wall_of(volume(scan="s.h5", scan_digest=digest), tmp_path / "v.h5", None)
    assert (own.width_m, own.height_m, own.confocal) == (1.8, 1.3, False)
    assert wall_of(volume(scan="s.h5", scan_digest="another"), tmp_path / "v.h5", None) is None
    assert wall_of(volume(scan="gone.h5", scan_digest=digest), tmp_path / "v.h5", None) is None


def test_a_built_in_scene_is_a_truth():
    from simulators.scenes import scene as built_in

    np.testing.assert_array_equal(
        true_depth("scene:letters", X_M, Y_M), built_in("letters").depth_map(X_M, Y_M)
    )
    with pytest.raises(UsageError, match=r"scene:ships.*letters"):
        true_depth("scene:ships", X_M, Y_M)


@pytest.mark.parametrize(
    ("name", "arrays", "error", "said"),
    [
        ("t.npz", {"x_m": X_M, "y_m": Y_M}, DataFileError, "lacks occupied, z_m"),
        ("t.npz", {"depth_m": np.ones((3, 4)), "x_m": X_M, "y_m": Y_M}, DataFileError, "its axes say"),
        ("t.npz", None, DataFileError, "cannot be read"),
        ("t.h5", {"depth_m": np.ones(3)}, DataFileError, "no group 'truth'"),
        ("t.obj", None, DataFileError, "mesh|triangles"),
        ("t.png", None, UsageError, "not a truth that can be read"),
        ("gone.npz", False, DataFileError, "does not exist"),
    ],
)
def test_what_is_no_truth_is_refused(tmp_path, name, arrays, error, said):
    if name == "t.obj":
        pytest.importorskip("trimesh", reason="trimesh is not installed")
    if arrays is None:
        (tmp_path / name).write_bytes(b"nothing of the kind")
    elif name.endswith(".npz") and arrays:
        np.savez(tmp_path / name, **arrays)
    elif arrays:
        with h5py.File(tmp_path / name, "w") as file:
            for key, value in arrays.items():
                file[key] = value
    with pytest.raises(error, match=said):
        true_depth(str(tmp_path / name), X_M, Y_M)


def test_frames_and_darkness_are_not_measured():
    frames = volume(intensity=np.ones((2, *volume().intensity.shape), "f4"), t_s=np.array([0.0, 1e-9]))
    with pytest.raises(UsageError, match="time axis"):
        measure(frames)
    with pytest.raises(UsageError, match="zero everywhere"):
        measure(volume(intensity=np.zeros_like(volume().intensity)))


def test_a_person_reads_a_table(rig, tmp_path):
    write_volume(tmp_path / "v.h5", volume())
    np.savez(tmp_path / "t.npz", depth_m=rectangle(), x_m=X_M, y_m=Y_M)
    done = rig("measure", "v.h5", "--truth", "t.npz")
    assert done.code == 0
    assert "1 (intersection over union)" in done.out
    assert "median 4 mm" in done.out
    assert "100.0 %" in done.out


# --- letters rendered by others


def test_the_rendered_meshes_are_the_rendered_depth_map():
    """Two truths of one file, of which this program made neither: our first surface against their map."""
    with h5py.File(published("rendered_letters.h5")) as file:
        depth_m, x_m, y_m = (file["truth"][name][()].astype(float) for name in ("depth_m", "x_m", "y_m"))
        triangles_m = [mesh["vertices_m"][()][mesh["faces"][()]] for mesh in file["truth/geometry"].values()]
    from recon.measures import surface_of_mesh

    ours = surface_of_mesh(np.concatenate(triangles_m), x_m, y_m)
    same = np.isfinite(ours) == np.isfinite(depth_m)
    # a pixel centre on a letter's very edge may fall to either side
    assert np.count_nonzero(~same) < 0.002 * same.size
    np.testing.assert_allclose(ours[same], depth_m[same], atol=1e-5)


def test_rendered_letters_are_where_they_are(rig, tmp_path):
    """The definition is that of docs/measures.md: seen at 0.05 of z^4 I, voxels of 2 cm, lambda = 5.6 cm."""
    source = published("rendered_letters.h5")
    import_scan(source, tmp_path / "letters.h5")
    grid = ["--voxel", "2cm", "--width", "1.8m", "--height", "1.8m", "--depth", "1m:1.95m:1cm"]
    assert rig("recon", "letters.h5", "--wavelength", "5.6cm", *grid).code == 0
    done = rig("measure", "letters-volume.h5", "--truth", source, "--threshold", "0.05", "--json")
    found = json.loads(done.out)
    # measured: 0.806, 0.9 mm, 0.956
    assert found["overlap"] >= 0.75
    assert abs(found["depth"]["median_m"]) <= 0.01
    assert found["depth"]["median_absolute_m"] <= 0.01
    assert found["depth"]["close"] >= 0.92
    # a picture that is mirrored, or upside down, or at another depth, is far from it
    image = read_volume(tmp_path / "letters-volume.h5")
    truth_m = true_depth(str(source), image.x_m, image.y_m)
    for wrong_m in (truth_m[:, ::-1], truth_m[::-1]):
        # a D upside down is nearly a D
        assert measure(image, wrong_m, threshold=0.05).document["overlap"] < found["overlap"] - 0.1
    assert measure(image, truth_m + 0.06, threshold=0.05).document["depth"]["close"] < 0.5
