"""The built-in scenes, and the truth that a picture of them is held against."""

import subprocess
import sys

import numpy as np
import pytest

from simulators.scenes import SCENES, Mesh, Scene, scene
from simulators.scenes.letters import letter_quads
from simulators.transport.geometry import cut
from simulators.transport.renderer import Transport
from simulators.transport.three_bounces import ThreeBounces
from simulators.transport.visibility import occluders

#: Points of the aperture, off the edges that scenes have at whole centimetres.
X_M, Y_M = np.arange(-0.9, 0.9, 0.031) + 1e-4, np.arange(-0.65, 0.65, 0.033) + 1e-4


@pytest.mark.parametrize("name", SCENES)
def test_scenes_stand_before_the_wall(name):
    built = scene(name)
    assert built.name == name
    assert len(built.albedo) == len(built.mesh_index) == len(built.triangles_m)
    assert (built.triangles_m[..., 2] >= 0).all()
    assert len({mesh.name for mesh in built.meshes}) == len(built.meshes)
    fine = built.depth_map(np.linspace(-0.9, 0.9, 361) + 1e-4, np.linspace(-0.65, 0.65, 261) + 1e-4)
    if name != "empty":
        assert np.nanmin(fine) > 0.5
        assert np.nanmax(fine) <= 3.0


@pytest.mark.parametrize("name", [name for name in SCENES if name != "empty"])
def test_every_thing_in_a_scene_sends_light_to_the_detector(name):
    """Nothing stands where no light of three bounces gets, from at least one of a few spots."""
    built = scene(name)
    patches = cut(built)
    three = ThreeBounces(patches, occluders(built.triangles_m), (0.0, 0.0, 0.0))
    spots = [(x, y, 0.0) for x in (-0.8, 0.0, 0.8) for y in (-0.6, 0.6)]
    weight = sum(three.from_spot(spot)[0] for spot in spots)
    lit = np.bincount(built.mesh_index[patches.triangle], weight, len(built.meshes))
    assert (lit > 0).all(), [mesh.name for mesh, light in zip(built.meshes, lit, strict=True) if light == 0]


@pytest.mark.parametrize("name", SCENES)
def test_truth_agrees_with_rays_against_every_triangle(name):
    """Reference: solve (x, y, 0) + z e_z = a + b (p - a) + c (q - a) for all triangles at once."""
    built = scene(name)
    truth = built.truth(X_M, Y_M)
    a, p, q = np.moveaxis(built.triangles_m, 1, 0)
    facing = np.abs(np.cross(p - a, q - a)[:, 2]) > 1e-12
    inverse = np.linalg.inv(np.stack([p - a, q - a, np.tile([0, 0, -1.0], (len(a), 1))], axis=2)[facing])
    for row, y in enumerate(Y_M):
        spots = np.stack([X_M, np.full_like(X_M, y), np.zeros_like(X_M)], axis=1)
        b, c, z = np.moveaxis(np.einsum("tij,stj->sti", inverse, spots[:, None] - a[facing]), 2, 0)
        z = np.where((b >= 0) & (c >= 0) & (b + c <= 1) & (z > 0), z, np.inf)
        nearest = z.min(axis=1, initial=np.inf)
        assert np.nan_to_num(truth.depth_m[row], nan=np.inf) == pytest.approx(nearest, abs=1e-9)
        seen = np.isfinite(nearest)
        if seen.any():
            owner = built.mesh_index[facing][z.argmin(axis=1)]
            assert (truth.mesh[row][seen] == owner[seen]).all()
        assert (truth.mesh[row][~seen] == -1).all()


def test_scenes_have_the_sizes_of_the_paper():
    def size_m(*meshes):
        corners_m = np.concatenate([mesh.vertices_m for mesh in meshes])
        return np.ptp(corners_m, axis=0), corners_m.min(axis=0)[2]

    near, far = scene("letters-rd").meshes
    for mesh, depth_m in ((near, 1.25), (far, 1.7)):
        extent_m, z_m = size_m(mesh)
        assert extent_m == pytest.approx([0.75, 0.8, 0.0], abs=1e-12)
        assert z_m == depth_m
    extent_m, z_m = size_m(*scene("bookshelf").meshes)
    assert extent_m[:2] == pytest.approx([1.4, 0.5])
    assert z_m == 1.7
    corridor = scene("bookshelf-corridor")
    assert corridor.meshes[: len(scene("bookshelf").meshes)][0].name == "bookshelf"
    assert size_m(*corridor.meshes)[0] == pytest.approx([2, 2, 3])
    depths_m = [mesh.vertices_m[0, 2] for mesh in scene("large-depth").meshes]
    assert (min(depths_m), max(depths_m)) == (0.8, 3.0)


def test_letters_rd_stand_where_the_rendered_ones_do():
    """Their shapes differ, their places do not: R near and to the camera's left, hiding part of D."""
    truth = scene("letters-rd").truth(X_M, Y_M)
    assert X_M[(truth.mesh == 0).any(axis=0)].mean() > 0 > X_M[(truth.mesh == 1).any(axis=0)].mean()
    alone = Scene("D", scene("letters-rd").meshes[1:]).truth(X_M, Y_M)
    assert 0.4 < (truth.mesh == 1).sum() / (alone.mesh == 0).sum() < 0.8


def test_the_office_spans_near_to_far_and_hides_part_of_itself():
    office = scene("office")
    truth = office.truth(X_M, Y_M)
    assert np.nanmin(truth.depth_m) < 0.7
    assert np.nanmax(truth.depth_m) == 3.0
    assert len(np.unique(truth.mesh)) > 8
    assert any(mesh.roughness < 0.5 for mesh in office.meshes)


def test_the_office_spreads_its_light_as_a_room_does():
    """Table 1, office, 1 s: 265 029 photons a position and at most 1406 in one bin of 4 ps.

    A card parallel to the wall returns all its light at once, and would be several times brighter. Light is
    summed over 64 ps, the width of the rig's response; "same order" is within half a decade.
    """
    office = scene("office")
    spots_m = np.array([(x, y, 0.0) for x in np.linspace(-0.8, 0.8, 9) for y in np.linspace(-0.6, 0.6, 5)])
    edges_s = np.arange(3.3e-9, 48e-9, 64e-12)
    light = Transport.of_scene(office).transients(spots_m, np.zeros((1, 3)), edges_s)
    counts_per_4ps = light * 265_029 / light.sum(axis=1).mean() / 16
    assert 1406 / 10**0.5 < counts_per_4ps.max() < 1406 * 10**0.5


def test_unknown_scene_names_those_that_exist():
    with pytest.raises(ValueError, match=r"'teapot'.*letters, letter-plane, .*or give the path of an OBJ"):
        scene("teapot")


def test_empty_scene_is_empty_everywhere():
    truth = scene("empty").truth(np.linspace(-1, 1, 5), np.linspace(-1, 1, 4))
    assert truth.depth_m.shape == (4, 5)
    assert np.isnan(truth.depth_m).all()
    assert (truth.mesh == -1).all()


def test_truth_of_letters_follows_from_their_strokes():
    """Reference: a point is on a letter if it is to the left of all four edges of one of its quads."""
    x_m, y_m = np.linspace(-0.9, 0.9, 181) + 1e-4, np.linspace(-0.65, 0.65, 131) + 1e-4
    expected = np.full((131, 181), np.nan)
    places = [("R", -0.20, 0.04, 1.5, 0.5, 0.66), ("F", 0.16, -0.02, 1.0, 0.45, 0.6)]  # far to near
    for character, x, y, z, width_m, height_m in places:
        u = -(x_m[None, :] - x) + width_m / 2 + 0 * y_m[:, None]
        v = (y_m[:, None] - y) + height_m / 2 + 0 * x_m[None, :]
        for quad in letter_quads(character, width_m=width_m, height_m=height_m, stroke_m=0.09):
            inside = np.ones_like(u, dtype=bool)
            for (u0, v0), (u1, v1) in zip(quad, np.roll(quad, -1, axis=0), strict=True):
                inside &= (u1 - u0) * (v - v0) - (v1 - v0) * (u - u0) >= 0
            expected[inside] = z
    truth = scene("letters").truth(x_m, y_m)
    assert np.array_equal(truth.depth_m, expected, equal_nan=True)
    assert np.array_equal(truth.mesh == 0, expected == 1.0)
    assert np.array_equal(truth.mesh == 1, expected == 1.5)


def test_the_near_letter_hides_part_of_the_far_one():
    x_m, y_m = np.linspace(-0.9, 0.9, 361), np.linspace(-0.65, 0.65, 261)
    both = scene("letters")
    far = Scene("far", both.meshes[1:])
    alone = np.isfinite(far.depth_map(x_m, y_m)).sum()
    left = (both.truth(x_m, y_m).mesh == 1).sum()
    assert 0.5 * alone < left < 0.97 * alone


def test_truth_on_a_slant_is_the_plane_and_follows_the_axes():
    slant = Mesh("slant", np.array([[-1, -1, 1.0], [1, -1, 1.4], [0, 2, 1.9]]), np.array([[0, 1, 2]]))
    x_m, y_m = np.linspace(-0.3, 0.3, 7), np.linspace(-0.5, 0.4, 5)
    depth_m = Scene("slant", (slant,)).depth_map(x_m, y_m)
    # z = 1.2 + 0.2 x + (0.7 / 3) (y + 1), which goes through the three corners
    assert depth_m == pytest.approx(1.2 + 0.2 * x_m[None, :] + 0.7 / 3 * (y_m[:, None] + 1), abs=1e-12)
    assert np.array_equal(Scene("slant", (slant,)).depth_map(x_m[::-1], y_m), depth_m[:, ::-1])


def test_albedo_may_differ_between_faces():
    corners = np.array([[0, 0, 1.0], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
    mesh = Mesh("two", corners, np.array([[0, 1, 2], [0, 2, 3]]), np.array([0.2, 0.9]))
    assert Scene("two", (mesh,)).albedo.tolist() == [0.2, 0.9]


def test_importing_bench_and_scenes_does_not_load_numba():
    code = "import sys, simulators, simulators.bench, simulators.scenes; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
