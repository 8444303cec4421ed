"""Laws of the fourth and fifth bounce, and slow references written anew for scenes of two plates."""

import numpy as np
import pytest
from scipy.stats import chi2

from simulators.constants import C_M_PER_S
from simulators.scenes import Scene, quads_mesh, scene
from simulators.transport.clusters import form_factors, gather, with_wall
from simulators.transport.extra_bounces import BIN_M, WALL_M, WALL_PITCH_M, Interreflections
from simulators.transport.patches import tessellate
from simulators.transport.renderer import Transport
from simulators.transport.three_bounces import ThreeBounces, form_factors_from
from simulators.transport.visibility import occluders

P, C = (0.4, -0.2, 0.0), (-0.3, 0.1, 0.0)

#: Two plates of 30 cm that face the wall and each other, as corner and two edges [m].
LEFT = np.array([[-0.55, -0.15, 0.8], [0.25, 0, 0.25], [0, 0.3, 0]])
RIGHT = np.array([[0.6, -0.2, 0.75], [-0.2, 0.05, 0.3], [0, 0.3, 0.02]])
ALBEDO = (0.7, 0.5)


def plate(name, sides, albedo):
    corner, u, v = sides
    return quads_mesh(name, np.array([[corner, corner + u, corner + u + v, corner + v]]), albedo)


TWO = Scene("two", (plate("left", LEFT, ALBEDO[0]), plate("right", RIGHT, ALBEDO[1])))


def between(built, bounces, **options):
    return Interreflections(tessellate(built), occluders(built.triangles_m), bounces, **options)


def samples(sides, number, rng):
    """Points on a plate, its normal, and its area."""
    corner, u, v = sides
    across = np.cross(u, v)
    points = corner + rng.random((number, 1)) * u + rng.random((number, 1)) * v
    return points, across / np.linalg.norm(across), np.linalg.norm(across)


def exchange(a, n_a, b, n_b):
    """Form factor of two points [1/m^2], and their distance."""
    ray = b - a
    r = np.linalg.norm(ray, axis=-1)
    return np.abs((ray * n_a).sum(-1) * (ray * n_b).sum(-1)) / (np.pi * r**4), r


def monte_carlo(order, number, seed=0):
    """Weights and paths of light laser, plates in ``order``, detector, at random points of the plates."""
    rng = np.random.default_rng(seed)
    at, normal, path_m, weight = np.array(P), np.array([0, 0, 1.0]), 0.0, 1.0 / number
    for which in order:
        points, towards, area_m2 = samples((LEFT, RIGHT)[which], number, rng)
        factor, r = exchange(at, normal, points, towards)
        weight, path_m = weight * factor * area_m2 * ALBEDO[which], path_m + r
        at, normal = points, towards
    factor, r = exchange(at, normal, np.array(C), np.array([0, 0, 1.0]))
    return weight * factor, path_m + r


@pytest.mark.parametrize("bounces", [4, 5])
def test_two_plates_agree_with_a_slow_monte_carlo(bounces):
    """Without the wall's part. 400 000 paths leave 0.5 % of noise, clusters less."""
    orders = {4: [(0, 1), (1, 0)], 5: [(0, 1, 0), (1, 0, 1)]}
    drawn = [monte_carlo(order, 400_000) for order in orders[bounces]]
    edges_m = np.arange(1.5, 6.0, 0.06)
    expected = sum(np.histogram(path_m, edges_m, weights=weight)[0] for weight, path_m in drawn)
    ours = transient_of(bounces, edges_m / C_M_PER_S)
    assert ours.sum() == pytest.approx(expected.sum(), rel=0.01)
    middle_m = (edges_m[1:] + edges_m[:-1]) / 2
    means_m = [(row @ middle_m) / row.sum() for row in (ours, expected)]
    assert means_m[0] == pytest.approx(means_m[1], abs=BIN_M / 2)
    assert np.abs(ours - expected).sum() < 0.05 * expected.sum()


def transient_of(bounces, edges_s):
    """Light of exactly so many bounces between the two plates."""
    rows = {
        n: between(TWO, n, wall_albedo=0.0).light_paths(C).transient(P, edges_s)
        for n in range(4, bounces + 1)
    }
    return rows[5] - rows[4] if bounces == 5 else rows[4]


def test_over_the_relay_wall_a_single_patch_sees_itself_again():
    """A patch has no fourth bounce; its fifth is integrated here over the same part of the wall, finely."""
    built, albedo = scene("point"), 0.6
    assert between(built, 4).light_paths(C).from_spot(P)[0].sum() == 0
    ours = between(built, 5, wall_albedo=albedo).light_paths(C).from_spot(P)[0].sum()
    x, y = np.meshgrid(*((np.arange(400) + 0.5) / 400 * size - size / 2 for size in WALL_M))
    to_wall = 1 / (np.pi * (1 + x**2 + y**2) ** 2)  # z = 1 m: cos^2 / (pi r^2) = 1 / (pi r^4)
    returned = albedo * (to_wall**2).sum() * WALL_M[0] * WALL_M[1] / x.size
    ends = np.prod([0.8 * 4e-4 / (np.pi * (1 + s[0] ** 2 + s[1] ** 2) ** 2) for s in (P, C)])
    # the rule of squares of 10 cm at 1 m, (0.1)^2 / 24 times the curvature, and the area in the form factor
    assert ours == pytest.approx(ends * returned, rel=0.01)


@pytest.mark.parametrize("bounces", [4, 5])
@pytest.mark.parametrize("built", [TWO, scene("shelf")], ids=lambda built: built.name)
def test_swapping_laser_and_detector_changes_nothing(built, bounces):
    """In all light and in its mean time; what is cut off the tails, 1e-6, may differ."""
    exchange = between(built, bounces, clusters=300)
    light, path_m = exchange.light_paths(C).arrivals(P)
    swapped, swapped_path_m = exchange.light_paths(P).arrivals(C)
    assert light.sum() == pytest.approx(swapped.sum(), rel=1e-5)
    mean_m = light @ path_m / light.sum()
    assert mean_m == pytest.approx(swapped @ swapped_path_m / swapped.sum(), rel=1e-5)


def room():
    """Five walls, of the relay wall's size in front; the relay wall closes them."""
    x, y, z = WALL_M[0] / 2, WALL_M[1] / 2, 1.6
    a, b, c, d = ([s * x, t * y] for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    quads = [[[*p, 0], [*q, 0], [*q, z], [*p, z]] for p, q in ((a, b), (b, c), (c, d), (d, a))]
    return Scene("room", (quads_mesh("walls", np.array([*quads, [[*p, z] for p in (a, b, c, d)]])),))


def test_in_a_closed_room_all_light_arrives_and_the_series_of_bounces_is_geometric():
    built, albedo = room(), 0.8
    clusters = with_wall(gather(tessellate(built), 1200), WALL_M, WALL_PITCH_M, albedo)
    forms, distances_m = form_factors(clusters, occluders(built.triangles_m))
    assert np.array_equal(forms, forms.T)
    assert np.array_equal(distances_m, distances_m.T)
    share = forms @ clusters.area_m2  # of what leaves each cluster, what arrives anywhere
    # clusters are 12 cm wide; what is missing is missing along the edges
    assert np.percentile(np.abs(share - 1), 80) < 0.02
    assert np.average(share, weights=clusters.area_m2) == pytest.approx(1, abs=0.01)
    assert share.max() < 1.001
    leaving = np.zeros(len(share))
    leaving[np.argmin(np.linalg.norm(clusters.centre_m - [0.1, 0.2, 1.6], axis=1))] = 1.0
    totals = [1.0]
    for _ in range(12):
        leaving = clusters.reflecting_m2 * (forms @ leaving)
        totals.append(leaving.sum())
    assert np.array(totals[1:]) / totals[:-1] == pytest.approx(albedo, rel=0.01)
    assert (np.array(totals[1:]) <= 1.001 * albedo * np.array(totals[:-1])).all()


def test_all_times_together_are_the_steady_state():
    """The tails' sum is the matrix product of form factors: nothing is lost or made in time."""
    exchange = between(scene("shelf"), 5, clusters=200)
    patches, clusters = exchange.patches, exchange.clusters
    three = ThreeBounces(patches, exchange.blockers, C)
    ours = exchange.light_paths(C).from_spot(P)[0].sum()
    assert 0 < ours < three.from_spot(P)[0].sum()
    facing = clusters.normal
    way = clusters.centre_m[None] - clusters.centre_m[:, None]
    side = (np.einsum("jka,ja->jk", way, facing) <= 0).astype(int)  # of j, towards k
    ends = []
    for spot in (P, C):
        outward = patches.normal * np.where(clusters.flipped, -1, 1)[:, None]
        of_cluster = ((patches.centre_m - np.array(spot)) * outward).sum(axis=1) > 0
        seen_m2 = np.abs(form_factors_from(patches, exchange.blockers, np.array(spot))[0])
        light = patches.area_m2 * patches.albedo * seen_m2
        ends.append(np.zeros((len(facing), 2)))
        np.add.at(ends[-1], (clusters.member, of_cluster.astype(int)), light)
    first, last = ends
    j, k = np.indices(exchange.forms.shape)
    once = exchange.forms * first[j, side] * last[k, side.T]
    lit = np.stack([(exchange.forms * (s == side.T) * first[j, side]).sum(axis=0) for s in (0, 1)], axis=1)
    seen = np.stack([(exchange.forms * (side == s) * last[k, side.T]).sum(axis=1) for s in (0, 1)], axis=1)
    twice = (lit * seen * clusters.reflecting_m2[:, None]).sum()
    assert ours == pytest.approx(once.sum() + twice, rel=1e-5)  # 1e-6 of each tail is cut off


def test_extra_bounces_come_later_than_the_third_by_way_of_the_same_patch():
    exchange = between(scene("shelf"), 5, clusters=400)
    extra, path_m = exchange.light_paths(C).from_spot(P)
    direct, direct_path_m = ThreeBounces(exchange.patches, exchange.blockers, C).from_spot(P)
    both = (extra > 0) & (direct > 0)
    assert both.sum() > 1000
    assert (path_m > direct_path_m)[both].all()


def test_random_paths_follow_the_transient():
    """Chi-square of 100 000 draws in bins of 10 cm, ten times the tails' own."""
    way = between(scene("shelf"), 5, clusters=300).light_paths(C)
    edges_m = np.arange(2.0, 9.0, 0.1)
    expected = way.transient(P, edges_m / C_M_PER_S)
    weight, _ = way.from_spot(P)
    assert expected.sum() == pytest.approx(weight.sum(), rel=1e-4)
    assert way.flux(P) == weight.sum()
    path_m = way.sample(P, 100_000, np.random.default_rng(3))
    drawn, _ = np.histogram(path_m, edges_m)
    expected *= len(path_m) / weight.sum()
    enough = expected > 20
    statistic = ((drawn - expected)[enough] ** 2 / expected[enough]).sum()
    assert statistic < chi2.isf(1e-6, enough.sum())


def test_nothing_gets_into_a_closed_box():
    corners = np.array(np.meshgrid([-0.2, 0.2], [-0.2, 0.2], [0.9, 1.3], indexing="ij")).reshape(3, 8).T
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    box = quads_mesh("box", corners[np.array(faces)], 0.8)
    inside = quads_mesh(
        "inside", np.array([[[-0.1, 0, 1], [0.1, 0, 1], [0.1, 0.05, 1.1], [-0.1, 0.05, 1.1]]])
    )
    exchange = between(Scene("full", (box, inside)), 5)
    way = exchange.light_paths(C)
    weight = way.from_spot(P)[0]
    assert weight.sum() > 0  # over the relay wall
    assert weight[exchange.patches.triangle >= 12].sum() == 0


@pytest.mark.parametrize("bounces", [4, 5])
def test_an_empty_room_has_no_extra_bounces(bounces):
    way = between(scene("empty"), bounces).light_paths(C)
    assert way.from_spot(P)[0].sum() == 0
    assert way.transient(P, np.linspace(0, 1e-8, 4)).tolist() == [0, 0, 0]


def test_bounces_add_to_each_other_row_by_row():
    built, edges_s = scene("letters"), np.arange(0, 30e-9, 100e-12)
    patches, spots = tessellate(built), np.array([P, (0.1, 0.5, 0.0)])
    rows = {
        n: Transport(patches, built.triangles_m, bounces=n).transients(spots, np.array([C]), edges_s)
        for n in (3, 4, 5)
    }
    assert (rows[4] >= rows[3]).all()
    assert (rows[5] >= rows[4] * (1 - 1e-12)).all()
    four = Transport(patches, built.triangles_m, bounces=4).light_paths(C)
    assert rows[4][0] == pytest.approx(sum(way.transient(P, edges_s) for way in four), rel=1e-12)
    with pytest.raises(ValueError, match="6 bounces cannot be followed"):
        Transport(patches, built.triangles_m, bounces=6)
