"""A surface that is exported stands where the truth is, in the programs that read meshes."""

import numpy as np
import pytest

from rig.errors import UsageError
from rig.exporters import export
from rig.exporters.surface import surface_mesh
from rig.files import Volume, write_volume

X_M, Y_M, Z_M = np.linspace(-0.6, 0.6, 121), np.linspace(-0.4, 0.4, 81), np.linspace(0.5, 2.0, 16)
NEAR_M, FAR_M = 1.0, 1.5


def volume(depth_m, **changes):
    intensity = np.ones((len(Z_M), len(Y_M), len(X_M)), "f4")
    given = {"x_m": X_M, "y_m": Y_M, "z_m": Z_M, "depth_m": depth_m, "scan": "a\nscan — b.h5"}
    return Volume(intensity, **(given | changes))


def two_boards():
    """A board of 40 x 30 cm at 1 m, in front of a tilted one of 60 x 50 cm that begins at 1.5 m."""
    x, y = np.meshgrid(X_M, Y_M)
    depth_m = np.full(x.shape, np.nan)
    depth_m[(np.abs(x + 0.2) < 0.301) & (np.abs(y) < 0.251)] = 0
    depth_m += FAR_M + 0.5 * (x + 0.5)
    depth_m[(np.abs(x - 0.2) < 0.201) & (np.abs(y) < 0.151)] = NEAR_M
    return depth_m.astype("f4")


@pytest.mark.parametrize("ending", ["ply", "glb"])
def test_a_mesh_program_finds_the_boards_where_they_are(tmp_path, ending):
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    write_volume(tmp_path / "v.h5", volume(two_boards()))
    export(tmp_path / "v.h5", tmp_path / f"v.{ending}")
    mesh = trimesh.load(tmp_path / f"v.{ending}", force="mesh")
    is_near = (mesh.triangles[:, :, 2] < 1.01).all(axis=1)
    near, far = (mesh.submesh([np.flatnonzero(part)], append=True) for part in (is_near, ~is_near))
    np.testing.assert_allclose(near.bounds, [[0.0, -0.15, NEAR_M], [0.4, 0.15, NEAR_M]], atol=1e-6)
    np.testing.assert_allclose(far.bounds[:, :2], [[-0.5, -0.25], [0.1, 0.25]], atol=1e-6)
    assert near.area == pytest.approx(0.4 * 0.3, rel=1e-5)
    # The far board rises by 0.5 and is hidden by the near one from x = 0 to 0.1, at heights of -0.15 to 0.15;
    # on the pixels' centres a strip of a pixel around the hidden part belongs to no board.
    hidden = 0.11 * 0.32
    assert far.area == pytest.approx((0.6 * 0.5 - hidden) * np.sqrt(1.25), rel=1e-3)
    np.testing.assert_allclose(far.vertices[:, 2], FAR_M + 0.5 * (far.vertices[:, 0] + 0.5), atol=1e-6)
    # towards the wall: what is seen is the front
    np.testing.assert_allclose(near.face_normals, np.tile([0, 0, -1.0], (len(near.faces), 1)), atol=1e-6)
    np.testing.assert_allclose(far.vertex_normals[:, 2], -1 / np.sqrt(1.25), atol=1e-3)


def test_colours_and_normals_are_in_the_file(tmp_path):
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    write_volume(tmp_path / "v.h5", volume(two_boards()))
    export(tmp_path / "v.h5", tmp_path / "v.ply")
    mesh, wanted = trimesh.load(tmp_path / "v.ply", process=False), surface_mesh(volume(two_boards()))
    np.testing.assert_array_equal(mesh.visual.vertex_colors[:, :3], wanted.colours)
    np.testing.assert_array_equal(mesh.faces, wanted.faces)
    lightness = mesh.visual.vertex_colors[:, :3].sum(axis=1)
    assert lightness[mesh.vertices[:, 2] < 1.01].max() < lightness[mesh.vertices[:, 2] > 1.75].min()


def test_nothing_is_joined_over_an_edge_or_a_gap():
    depth_m = np.full((len(Y_M), len(X_M)), np.nan, "f4")
    depth_m[10:14, 10:14] = 1.0
    depth_m[10:14, 12:] = 1.05  # 5 cm behind: more than three pixels of 1 cm
    depth_m[20, 20] = 1.2  # alone
    mesh = surface_mesh(volume(depth_m))
    depths_m = mesh.vertices_m[mesh.faces, 2]
    assert np.ptp(depths_m, axis=1).max() == 0
    assert len(mesh.vertices_m) == 4 * 2 + 4 * (len(X_M) - 12) + 1
    assert len(mesh.faces) == 2 * (3 * 1 + 3 * (len(X_M) - 13))
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-6)


@pytest.mark.parametrize("missing", range(4))
def test_three_corners_make_one_triangle(missing):
    depth_m = np.full((len(Y_M), len(X_M)), np.nan, "f4")
    depth_m[5:7, 5:7] = 1.0
    depth_m[5 + missing // 2, 5 + missing % 2] = np.nan
    mesh = surface_mesh(volume(depth_m))
    assert mesh.faces.shape == (1, 3)
    a, b, c = mesh.vertices_m[mesh.faces[0]]
    assert np.cross(b - a, c - a)[2] < 0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"depth_m": None}, "no depth map"),
        ({"depth_m": np.full((len(Y_M), len(X_M)), np.nan, "f4")}, "no surface above noise"),
        ({"x_m": np.sort(np.random.default_rng(1).random(len(X_M)))}, "not evenly spaced"),
    ],
)
@pytest.mark.parametrize("ending", ["ply", "glb"])
def test_what_has_no_surface_is_refused(tmp_path, changes, said, ending):
    write_volume(tmp_path / "v.h5", volume(**({"depth_m": two_boards()} | changes)))
    with pytest.raises(UsageError, match=said):
        export(tmp_path / "v.h5", tmp_path / f"v.{ending}")
    assert not (tmp_path / f"v.{ending}").exists()
