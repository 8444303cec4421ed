"""Cutting surfaces small loses and adds nothing; what hides what agrees with a slow solver."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.scenes import scene
from simulators.transport.patches import USUAL_PATCHES, subdivide, tessellate
from simulators.transport.visibility import PACKET, STACK, occluders, shade

coordinate = st.floats(-1, 1, allow_nan=False).map(lambda value: round(value, 3))
triangle = st.tuples(*[st.tuples(coordinate, coordinate, coordinate)] * 3).map(np.array)


def areas(triangles_m):
    edge = triangles_m[:, 1:] - triangles_m[:, :1]
    return 0.5 * np.linalg.norm(np.cross(edge[:, 0], edge[:, 1]), axis=1)


@settings(max_examples=60)
@given(st.lists(triangle, min_size=1, max_size=3), st.sampled_from([0.1, 0.3, 1.0, 5.0]))
def test_subdivision_keeps_area_and_centroid_of_every_triangle(triangles, edge_m):
    triangles_m = np.array(triangles, dtype=float)
    pieces_m, parent = subdivide(triangles_m, edge_m)
    assert (np.linalg.norm(np.roll(pieces_m, -1, axis=1) - pieces_m, axis=2) <= edge_m).all()
    # halving is exact but for rounding, which for coordinates of order 1 stays below 1e-15 a cut
    total = np.bincount(parent, areas(pieces_m), minlength=len(triangles_m))
    assert total == pytest.approx(areas(triangles_m), abs=1e-12)
    for axis in range(3):
        moments = np.bincount(
            parent, areas(pieces_m) * pieces_m.mean(axis=1)[:, axis], minlength=len(triangles_m)
        )
        assert moments == pytest.approx(areas(triangles_m) * triangles_m.mean(axis=1)[:, axis], abs=1e-12)


def test_large_scenes_are_cut_coarser():
    letters, office = (np.sqrt(tessellate(scene(name)).area_m2.max()) for name in ("letters", "office"))
    assert letters < 0.0142  # legs of edge / sqrt(2), and half of the square
    assert 0.02 < office < 0.06
    assert len(tessellate(scene("office")).area_m2) < 2 * USUAL_PATCHES


def test_patches_of_a_scene_carry_its_area_and_albedo():
    letters = scene("letters")
    patches = tessellate(letters)
    assert patches.area_m2.sum() == pytest.approx(areas(letters.triangles_m).sum(), rel=1e-12)
    assert np.linalg.norm(patches.normal, axis=1) == pytest.approx(1.0)
    assert (patches.albedo == 0.8).all()
    assert set(patches.triangle) == set(range(len(letters.triangles_m)))


def reference_hidden(triangles_m, a, b):
    """Solve a + t (b - a) = p + u (q - p) + v (r - p) for each triangle."""
    for p, q, r in triangles_m:
        matrix = np.stack([a - b, q - p, r - p], axis=1)
        if abs(np.linalg.det(matrix)) < 1e-12:
            continue
        t, u, v = np.linalg.solve(matrix, a - p)
        if 1e-6 < t < 1 - 1e-6 and u >= 0 and v >= 0 and u + v <= 1:
            return True
    return False


def test_shade_agrees_with_a_linear_solver():
    rng = np.random.default_rng(5)
    triangles_m = rng.uniform(-1, 1, (12, 3, 3)) * 0.6 + [0, 0, 1.0]
    blockers = occluders(triangles_m)
    checked = 0
    for spot in rng.uniform(-1, 1, (12, 3)) * [1, 1, 0]:
        points = rng.uniform((-1, -1, 0.3), (1, 1, 2.3), (60, 3))
        light = np.ones(60)
        shade(blockers, spot, points, light)
        expected = [not reference_hidden(triangles_m, spot, point) for point in points]
        assert light.astype(bool).tolist() == expected
        checked += 60 - int(light.sum())
    assert checked > 100  # a fair part was really hidden


@settings(max_examples=150)
@given(
    st.lists(triangle, min_size=1, max_size=40),
    st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=1, max_size=80),
    st.tuples(coordinate, coordinate, coordinate),
)
def test_the_tree_of_boxes_finds_what_each_triangle_alone_hides(triangles, points, spot):
    """Coordinates are rounded, so that many triangles and segments are flat, parallel or touch."""
    triangles_m, points_m = np.array(triangles, dtype=float), np.array(points)
    light = np.ones(len(points_m))
    shade(occluders(triangles_m), np.array(spot), points_m, light)
    alone = np.ones(len(points_m))
    for one in triangles_m:
        shade(occluders(one[None]), np.array(spot), points_m, alone)
    assert light.tolist() == alone.tolist()


@pytest.mark.parametrize("name", ["letters", "shelf"])
def test_points_shaded_together_are_shaded_as_each_alone_by_each_triangle(name):
    """Neighbours and strangers in a packet, lit and dark ones, in few triangles and in some hundreds."""
    rng, built = np.random.default_rng(9), scene(name)
    patches, blockers = tessellate(built), occluders(built.triangles_m)
    near = patches.centre_m[2000 : 2000 + PACKET + 3] + np.array([0, 0, 0.4])
    points_m = np.concatenate([near, rng.uniform((-1, -0.8, 0.2), (1, 0.8, 2.5), (40, 3))])
    lit = rng.random(len(points_m)) < 0.8
    for spot in rng.uniform((-0.9, -0.6, 0), (0.9, 0.6, 0), (2, 3)):
        light, alone = lit.astype(float), lit.astype(float)
        shade(blockers, spot, points_m, light)
        for k in range(len(points_m)):
            for one in built.triangles_m if alone[k] else ():
                shade(occluders(one[None]), spot, points_m[k : k + 1], alone[k : k + 1])
                if not alone[k]:
                    break
        assert light.tolist() == alone.tolist()
        assert 0 < light.sum() < lit.sum()


def test_a_tree_over_many_triangles_is_complete_and_within_the_stack():
    rng = np.random.default_rng(8)
    near, far = rng.uniform(-1, 1, (10_000, 1, 3)), rng.uniform(-1, 1, (10_000, 1, 3)) ** 9
    triangles_m = np.concatenate([near, far]) + rng.uniform(-0.02, 0.02, (20_000, 3, 3))
    tree = occluders(triangles_m)
    leaves = tree.size > 0
    assert tree.size[leaves].sum() == 20_000
    assert sorted(tree.first[leaves]) == np.cumsum([0, *tree.size[leaves]])[:-1].tolist()
    assert len(tree.size) < 2 * 20_000

    def depth(node):
        return 1 if leaves[node] else 1 + max(depth(node + 1), depth(tree.first[node]))

    assert depth(0) < STACK


def test_a_surface_does_not_hide_itself():
    letters = scene("letter-plane")
    patches = tessellate(letters)
    light = np.ones(len(patches.area_m2))
    shade(occluders(letters.triangles_m), np.array([0.8, -0.6, 0.0]), patches.centre_m, light)
    assert light.all()


def test_a_plate_casts_exactly_its_shadow():
    """Rays from the origin through a square at z = 0.5 shade twice that square at z = 1."""
    square = np.array([[-0.2, -0.1, 0.5], [0.1, -0.1, 0.5], [0.1, 0.3, 0.5], [-0.2, 0.3, 0.5]])
    blockers = occluders(square[np.array([[0, 1, 2], [0, 2, 3]])])
    x, y = np.meshgrid(np.linspace(-1, 1, 81) + 1e-3, np.linspace(-1, 1, 81) + 1e-3)
    points = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1)
    light = np.ones(len(points))
    shade(blockers, np.zeros(3), points, light)
    shadow = (np.abs(points[:, 0] + 0.1) < 0.3) & (np.abs(points[:, 1] - 0.2) < 0.4)
    assert np.array_equal(light == 0, shadow)
