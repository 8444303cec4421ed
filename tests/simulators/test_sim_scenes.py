"""The built-in scenes, and the truth that a picture of them is held against."""

import subprocess
import sys

import numpy as np
import pytest

from simulators.letters import letter_quads
from simulators.scenes import SCENES, Mesh, Scene, scene


@pytest.mark.parametrize("name", SCENES)
def test_scenes_stand_in_the_aperture_before_the_wall(name):
    built = scene(name)
    assert built.name == name
    corners_m = built.triangles_m.reshape(-1, 3)
    assert (np.abs(corners_m[:, 0]) <= 0.9).all()
    assert (np.abs(corners_m[:, 1]) <= 0.65).all()
    assert (corners_m[:, 2] > 0.5).all()
    assert len(built.albedo) == len(built.mesh_index) == len(built.triangles_m)


def test_unknown_scene_names_those_that_exist():
    with pytest.raises(ValueError, match=r"'teapot'.*letters, letter-plane, point, empty"):
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
