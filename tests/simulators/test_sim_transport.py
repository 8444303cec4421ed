"""Laws of light that three-bounce transport must keep, and a slow reference that it must agree with."""

import numpy as np
import pytest
from scipy.stats import chi2

from simulators.constants import C_M_PER_S
from simulators.scenes import Mesh, Scene, letter, quads_mesh, scene
from simulators.transport.geometry import Patches, cut
from simulators.transport.renderer import Transport
from simulators.transport.three_bounces import ThreeBounces
from simulators.transport.visibility import occluders

FACING = np.array([[0.01, -0.01, 0], [-0.01, -0.01, 0], [-0.01, 0.01, 0], [0.01, 0.01, 0]])


def plate(z_m, *, x_m=0.0, y_m=0.0, size=1.0, albedo=0.8, name="plate"):
    """A square parallel to the wall, 2 cm times ``size``."""
    return quads_mesh(name, (FACING * size + [x_m, y_m, z_m])[None], albedo)


def bounces(built, detector_spot_m=(0.0, 0.0, 0.0)):
    return ThreeBounces(cut(built), occluders(built.triangles_m), detector_spot_m)


def total(built, laser_spot_m, detector_spot_m=(0.0, 0.0, 0.0)):
    return bounces(built, detector_spot_m).from_spot(laser_spot_m)[0].sum()


def test_swapping_laser_and_detector_changes_nothing():
    """Helmholtz reciprocity, patch by patch; rounding of a few operations."""
    built, p, c = scene("letters"), (0.7, -0.4, 0.0), (-0.3, 0.25, 0.0)
    weight, path_m = bounces(built, c).from_spot(p)
    swapped, swapped_path_m = bounces(built, p).from_spot(c)
    assert weight == pytest.approx(swapped, rel=1e-12)
    assert path_m == pytest.approx(swapped_path_m, rel=1e-12)


def test_a_small_patch_gives_the_closed_form_and_falls_as_depth_to_the_minus_4():
    """On the axis both cosines are 1 within (1 cm / 1 m)^2 = 1e-4, which enters four times."""
    for z_m in (0.6, 1.0, 2.0, 4.0):
        built = Scene("far", (plate(z_m, albedo=0.5),))
        assert total(built, (0.0, 0.0, 0.0)) == pytest.approx(0.5 * 4e-4 / (np.pi**2 * z_m**4), rel=2e-3)


def test_each_leg_follows_its_own_distance_and_cosines():
    """A patch at (0, 0, 1): cos^2 / (pi r^2) = 1 / (pi r^4) for a spot at distance r, as r cos = 1."""
    p, c = np.array([0.6, 0.2, 0.0]), np.array([-0.3, -0.5, 0.0])
    r2_p, r2_c = 1 + p @ p, 1 + c @ c
    expected = 0.8 * 4e-4 / (np.pi**2 * r2_p**2 * r2_c**2)
    assert total(scene("point"), tuple(p), tuple(c)) == pytest.approx(expected, rel=2e-3)


def test_a_patch_returns_albedo_times_what_it_receives():
    """All that a patch parallel to the wall reflects falls on the infinite wall.

    Integrated with r = z tan(theta), s = sin(theta)^2, so that a Lambertian patch gives a constant in s; the
    patch is not quite a point, hence 1e-3.
    """
    z_m, x_p, albedo = 1.0, (0.4, -0.3, 0.0), 0.7
    built = Scene("one", (plate(z_m, albedo=albedo),))
    nodes, node_weights = np.polynomial.legendre.leggauss(6)
    leaving = 0.0
    for s, ds in zip((nodes + 1) / 2, node_weights / 2, strict=True):
        r_m, ring_m2 = z_m * np.sqrt(s / (1 - s)), np.pi * z_m**2 * ds / (1 - s) ** 2
        around = [
            total(built, x_p, (r_m * np.cos(a), r_m * np.sin(a), 0.0)) for a in np.arange(8) * np.pi / 4
        ]
        leaving += ring_m2 * np.mean(around)
    received = 4e-4 / (np.pi * (1 + 0.4**2 + 0.3**2) ** 2)
    assert leaving == pytest.approx(albedo * received, rel=1e-3)


def test_a_closed_room_receives_all_that_leaves_the_wall_and_the_wall_no_more_than_its_albedo():
    """Over a wide ceiling the form factors from one spot add up to the part of the hemisphere it fills."""
    half, z_m = 4.0, 1.0
    ceiling = quads_mesh("ceiling", (FACING / 0.01 * half + [0, 0, z_m])[None], 1.0)
    patches = cut(Scene("room", (ceiling,)), edge_m=0.15)
    one = ThreeBounces(patches, occluders(ceiling.triangles_m), (0.0, 0.0, 0.0))
    # weight = F(p, k) A_k F(k, c): with c = p, F A_k = sqrt(weight A_k), the share of light that patch k gets
    weight, _ = one.from_spot((0.0, 0.0, 0.0))
    share = np.sqrt(weight * patches.area_m2).sum()
    # form factor of a spot to a parallel square of half side a over it (Howell, catalogue B-4, four times)
    a = half / z_m
    known = 4 / (2 * np.pi) * 2 * a / np.sqrt(1 + a**2) * np.arctan(a / np.sqrt(1 + a**2))
    assert share == pytest.approx(known, rel=2e-3)  # midpoint rule, (0.15 m / 1 m)^2 / 12 times curvature
    assert share < 1


def test_occlusion_removes_exactly_the_hidden_patches():
    """A small plate before a large one: its shadow on each leg is its projection from that spot."""
    near, far = plate(0.7, x_m=0.05, size=8), plate(1.4, size=40, name="far")
    p, c = np.array([0.5, 0.1, 0.0]), np.array([-0.2, -0.3, 0.0])
    both, alone = Scene("both", (near, far)), Scene("alone", (far,))
    patches = cut(both)
    on_far = patches.triangle >= 2
    weight = bounces(both, tuple(c)).from_spot(tuple(p))[0]
    free = bounces(alone, tuple(c)).from_spot(tuple(p))[0]
    hidden = np.zeros(on_far.sum(), dtype=bool)
    for spot in (p, c):
        crossing = spot + (patches.centre_m[on_far] - spot) * 0.5  # where the ray passes z = 0.7
        hidden |= (np.abs(crossing[:, 0] - 0.05) < 0.08) & (np.abs(crossing[:, 1]) < 0.08)
    assert 20 < hidden.sum() < 0.7 * len(hidden)
    assert (weight[on_far][hidden] == 0).all()
    assert np.array_equal(weight[on_far][~hidden], free[~hidden])
    assert (weight[~on_far] > 0).all()


def test_surfaces_have_two_sides_and_light_does_not_pass_through():
    built = scene("letters")
    turned = Scene("turned", tuple(Mesh(m.name, m.vertices_m, m.faces[:, ::-1]) for m in built.meshes))
    p, c = (0.2, 0.1, 0.0), (-0.5, 0.3, 0.0)
    assert total(turned, p, c) == pytest.approx(total(built, p, c), rel=1e-12)
    upright = Mesh("upright", np.array([[0, -0.1, 1], [0, 0.1, 1], [0, 0, 1.2]]), np.array([[0, 1, 2]]))
    assert total(Scene("side", (upright,)), (0.5, 0, 0), (0.3, 0, 0)) > 0
    assert total(Scene("side", (upright,)), (0.5, 0, 0), (-0.3, 0, 0)) == 0


def test_nothing_comes_from_behind_the_wall_or_from_an_empty_room():
    assert total(Scene("behind", (plate(-1.0),)), (0.3, 0.0, 0.0)) == 0
    assert total(scene("empty"), (0.3, 0.0, 0.0)) == 0
    transient = bounces(scene("empty")).transient((0.1, 0.0, 0.0), np.linspace(0, 1e-8, 11))
    assert transient.tolist() == [0.0] * 10


def test_transient_holds_all_light_and_ignores_what_is_outside():
    three = bounces(scene("letters"), (0.1, 0.0, 0.0))
    weight, path_m = three.from_spot((-0.4, 0.2, 0.0))
    edges_s = np.arange(0, 16e-9, 16e-12)
    assert three.transient((-0.4, 0.2, 0.0), edges_s).sum() == pytest.approx(weight.sum(), rel=1e-12)
    middle_s = np.median(path_m) / C_M_PER_S
    halves = [
        three.transient((-0.4, 0.2, 0.0), e).sum() for e in np.array([[0, middle_s], [middle_s, 16e-9]])
    ]
    assert sum(halves) == pytest.approx(weight.sum(), rel=1e-12)
    assert min(halves) > 0


def test_transient_agrees_with_a_sum_over_many_points():
    """Reference: a tilted triangle of half a metre as 40 000 equal points, with formulas written anew."""
    corners = np.array([[-0.3, -0.2, 0.9], [0.25, -0.1, 1.3], [0.05, 0.35, 1.1]])
    p, c = np.array([0.6, -0.5, 0.0]), np.array([-0.1, 0.4, 0.0])
    n = 200
    row, column = np.indices((n, n))
    up, down = row + column < n, row + column < n - 1
    b = np.concatenate([row[up] + 1 / 3, row[down] + 2 / 3]) / n
    g = np.concatenate([column[up] + 1 / 3, column[down] + 2 / 3]) / n
    points = corners[0] + b[:, None] * (corners[1] - corners[0]) + g[:, None] * (corners[2] - corners[0])
    across = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal, area_m2 = across / np.linalg.norm(across), np.linalg.norm(across) / 2

    def factor(spot):
        ray = points - spot
        r = np.linalg.norm(ray, axis=1)
        return (ray[:, 2] / r) * np.abs(ray @ normal / r) / (np.pi * r**2), r

    (f_p, r_p), (f_c, r_c) = factor(p), factor(c)
    edges_s = np.arange(6e-9, 14e-9, 50e-12)
    power = 0.6 * area_m2 / len(points) * f_p * f_c
    expected, _ = np.histogram((r_p + r_c) / C_M_PER_S, edges_s, weights=power)
    tilted = Scene("tilted", (Mesh("t", corners, np.array([[0, 1, 2]]), 0.6),))
    got = bounces(tilted, tuple(c)).transient(tuple(p), edges_s)
    assert got.sum() == pytest.approx(expected.sum(), rel=1e-3)  # 2 cm patches: (0.02 / 1)^2, a few times
    # a bin of 50 ps holds some 1000 points; its edge cuts rows of up to 60 of them by half a spacing
    assert np.abs(got - expected).max() < 0.03 * expected.max()


def test_confocal_is_each_spot_by_itself():
    built = scene("letter-plane")
    spots = np.array([[0.3, 0.1, 0.0], [-0.6, -0.2, 0.0], [0.0, 0.5, 0.0]])
    edges_s = np.arange(6e-9, 12e-9, 32e-12)
    together = Transport.of_scene(built).transients(spots, spots, edges_s)
    for spot, row in zip(spots, together, strict=True):
        assert np.array_equal(row, bounces(built, tuple(spot)).transient(tuple(spot), edges_s))
    fixed = Transport.of_scene(built).transients(spots, spots[:1], edges_s)
    assert fixed.shape == (3, len(edges_s) - 1)
    assert np.array_equal(fixed[0], together[0])
    assert not np.array_equal(fixed[1], together[1])
    with pytest.raises(ValueError, match="2 detector spots for 3 laser spots"):
        Transport.of_scene(built).transients(spots, spots[:2], edges_s)


def test_random_paths_follow_the_transient():
    """Chi-square of 200 000 draws; a right program fails one time in a million, but the seed is fixed."""
    built = Scene("mixed", (letter("4", centre_m=(0.1, 0.0, 1.1)), letter("S", centre_m=(-0.3, 0.1, 1.4))))
    three, p = bounces(built, (0.2, -0.1, 0.0)), (-0.5, 0.3, 0.0)
    edges_s = np.arange(6e-9, 14e-9, 20e-12)
    expected = three.transient(p, edges_s)
    number = 200_000
    path_m = three.sample(p, number, np.random.default_rng(11))
    drawn, _ = np.histogram(path_m / C_M_PER_S, edges_s)
    assert drawn.sum() == number
    expected *= number / expected.sum()
    enough = expected > 20  # so that each bin's deviation is nearly Gaussian
    statistic = ((drawn - expected)[enough] ** 2 / expected[enough]).sum()
    assert statistic < chi2.isf(1e-6, enough.sum())


def test_coarser_patches_tell_the_same_story():
    """Halving the patches moves less than 1 % of the light by a bin or more: the default is fine enough."""
    built, p = scene("letters"), np.array([[0.5, -0.3, 0.0]])
    edges_s = np.arange(6e-9, 14e-9, 32e-12)

    def at(edge_m) -> np.ndarray:
        patches: Patches = cut(built, edge_m)
        return Transport(patches, built.triangles_m).transients(p, np.zeros((1, 3)), edges_s)[0]

    usual, fine = at(0.02), at(0.01)
    assert np.abs(usual - fine).sum() < 0.01 * fine.sum()
