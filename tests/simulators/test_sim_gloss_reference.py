"""The gloss of GGX against light that meets facets drawn one by one, and against a mirror image."""

import numpy as np
import pytest
from microfacets import reflect

from simulators.constants import C_M_PER_S
from simulators.scenes import Mesh, Scene
from simulators.transport.patches import tessellate
from simulators.transport.reflectance import gloss
from simulators.transport.renderer import Transport
from support.thorough import some

RAYS, RAYS_TRACED = 1_000_000, 2_000_000
#: Cells of the disk under the hemisphere, and points along the side of a cell.
CELLS, POINTS = 20, 32
alphas = pytest.mark.parametrize("alpha", [0.1, 0.4, 0.8])


def lobe(alpha, i, o):
    """Reflectance (K,) [1/sr] from direction i (3,) to o (K, 3), without the Lambertian share."""
    far, here = 1e8 * np.array(i), np.zeros(3)  # all patches see a point so far away in one direction
    weight, all_ = np.ones(len(o)), np.ones(len(o), bool)
    gloss(weight, -o, np.tile([0.0, 0.0, 1.0], (len(o), 1)), alpha * weight, ~all_, all_, far, here)
    return (weight - alpha) / (1 - alpha) / np.pi


def on_disk(per_side):
    """Directions (N, 3) over the middles of small squares under the hemisphere, and an area: cos dOmega."""
    middles = (np.arange(per_side) + 0.5) / per_side * 2 - 1
    x, y = (values.ravel() for values in np.meshgrid(middles, middles, indexing="ij"))
    inside = x * x + y * y < 1
    up = np.sqrt(1 - (x * x + y * y)[inside])
    return np.column_stack([x[inside], y[inside], up]), (2 / per_side) ** 2, inside


def slanted(polar):
    return np.array([np.sin(polar), 0.0, np.cos(polar)])


@alphas
@pytest.mark.parametrize("polar", [0.0, 0.6, 1.2])
def test_every_direction_gets_what_facets_send(alpha, polar):
    """Cell by cell: five standard errors of any of 300, and no more scatter than counting makes."""
    i = slanted(polar)
    o, area, inside = on_disk(CELLS * POINTS)
    expected = np.zeros((CELLS * POINTS) ** 2)
    expected[inside] = lobe(alpha, i, o) * area
    expected = expected.reshape(CELLS, POINTS, CELLS, POINTS).sum(axis=(1, 3))
    whole = inside.reshape(CELLS, POINTS, CELLS, POINTS).all(axis=(1, 3))
    o, light = reflect(np.tile(i, (RAYS, 1)), alpha, np.random.default_rng(5))
    edges = np.linspace(-1, 1, CELLS + 1)
    found, squares, rays = (
        np.histogram2d(o[:, 0], o[:, 1], (edges, edges), weights=weights)[0]
        for weights in (light, light**2, light > 0)
    )
    looked_at = whole & (rays > 100)
    error = np.sqrt(squares[looked_at]) / RAYS
    z = (found[looked_at] / RAYS - expected[looked_at]) / error
    assert looked_at.sum() > 50
    assert np.abs(z).max() < 5
    assert (z**2).mean() < 1 + 5 * np.sqrt(2 / len(z))


@pytest.mark.parametrize("polar", some(0.6, 0.0, 1.2, short=1))
def test_what_a_white_surface_keeps_meets_a_second_facet(polar):
    """A sum over a million parts of the hemisphere: right to 1e-3 where the lobe is narrow and grazing."""
    i = slanted(polar)
    o, area, _ = on_disk(1000)
    kept = []
    for alpha in (0.1, 0.4, 0.8):
        _, light = reflect(np.tile(i, (RAYS, 1)), alpha, np.random.default_rng(6))
        total = lobe(alpha, i, o).sum() * area
        assert total == pytest.approx(light.mean(), abs=5 * light.std() / np.sqrt(RAYS) + 1e-3)
        kept.append(1 - total)
    assert 0 < kept[0] < kept[1] < kept[2]


def plate(alpha, corners_m, edge_m=None):
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    scene = Scene("plate", (Mesh("plate", corners_m, faces, ALBEDO, alpha, gloss="ggx"),))
    return Transport(tessellate(scene, edge_m), scene.triangles_m)


ALBEDO, LASER = 0.8, np.array([0.3, -0.2, 0.0])
#: A tilted plate of 0.6 m x 0.5 m: its middle, half its edges, and its normal, which is towards the wall.
MIDDLE, ALONG, UPWARDS = np.array([0.1, 0.05, 0.9]), np.array([0.3, 0.0, 0.1]), np.array([0.0, 0.25, -0.05])
NORMAL = np.cross(UPWARDS, ALONG) / np.linalg.norm(np.cross(UPWARDS, ALONG))
CORNERS = MIDDLE + np.array([-ALONG - UPWARDS, ALONG - UPWARDS, ALONG + UPWARDS, UPWARDS - ALONG])
#: Parts of the wall where light is caught.
SQUARES, SIDE_M = np.array([[-0.45, 0.25], [-0.1, 0.1], [-0.6, -0.4], [0.5, 0.4]]), 0.2
EDGES_M = np.arange(1.7, 3.2, 0.02)


def sent(alpha, rng):
    """Rays of the laser spot that leave the plate: paths (N,), points, directions (N, 3) and light (N,)."""
    axes = np.array([ALONG, np.cross(NORMAL, ALONG), NORMAL])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    u, v = rng.uniform(-1, 1, (2, RAYS_TRACED, 1))
    point_m = MIDDLE + u * ALONG + v * UPWARDS
    path_m = np.linalg.norm(LASER - point_m, axis=1)
    i = (LASER - point_m) / path_m[:, None] @ axes.T
    area_m2 = 4 * np.linalg.norm(np.cross(ALONG, UPWARDS))
    light = ALBEDO * area_m2 / RAYS_TRACED * (point_m[:, 2] / path_m) * i[:, 2] / (np.pi * path_m**2)
    o, share = reflect(i, alpha, rng)
    matt, outwards = rng.random((2, RAYS_TRACED))
    matt, around, across = matt < alpha, rng.uniform(0, 2 * np.pi, RAYS_TRACED), np.sqrt(outwards)
    o[matt] = np.column_stack([across * np.cos(around), across * np.sin(around), np.sqrt(1 - outwards)])[matt]
    light *= np.where(matt, 1.0, share)
    return path_m, point_m, o @ axes, light


def caught(alpha):
    """Transients (squares, bins) [1/m^2] of such rays on the wall, and the variances of their sums."""
    path_m, point_m, o, light = sent(alpha, np.random.default_rng(7))
    comes = (light > 0) & (o[:, 2] < 0)
    path_m, point_m, o, light = path_m[comes], point_m[comes], o[comes], light[comes]
    last_m = -point_m[:, 2] / o[:, 2]
    at_m = (point_m + last_m[:, None] * o)[:, :2]
    transients, variances = [], []
    for square in SQUARES:
        here = (np.abs(at_m - square) < SIDE_M / 2).all(axis=1)
        share = light[here] / SIDE_M**2
        transients.append(np.histogram((path_m + last_m)[here], EDGES_M, weights=share)[0])
        variances.append((share**2).sum())
    return np.array(transients), np.array(variances)


@pytest.mark.parametrize("alpha", some(0.4, 0.1, 0.8, short=1))
def test_transients_of_a_tilted_plate_agree_with_traced_rays(alpha):
    """Three bounces onto squares; ours are means of 7 x 7 detector spots (Gauss) in each.

    The difference over all bins of 2 cm is what counting makes, of 2000 rays on the dimmest square to 50 000,
    and 1 % for light that goes by the centres of patches and to 49 spots.
    """
    reference, variances = caught(alpha)
    nodes, weights = np.polynomial.legendre.leggauss(7)
    x, y = (SIDE_M / 2 * values.ravel() for values in np.meshgrid(nodes, nodes))
    spots = np.concatenate([np.column_stack([*(square[:, None] + [x, y]), 0 * x]) for square in SQUARES])
    lasers = np.tile(LASER, (len(spots), 1))
    each = plate(alpha, CORNERS).transients(lasers, spots, EDGES_M / C_M_PER_S)
    ours = np.einsum(
        "n,snb->sb", np.outer(weights, weights).ravel() / 4, each.reshape(len(SQUARES), len(x), -1)
    )
    for a, b, variance in zip(ours, reference, variances, strict=True):
        assert a.sum() == pytest.approx(b.sum(), abs=4 * np.sqrt(variance))
        assert np.linalg.norm(a - b) < 2 * np.sqrt(variance) + 0.01 * np.linalg.norm(b)


def test_a_smooth_plate_shows_the_laser_spot_behind_it():
    """A mirror makes of a Lambertian spot another one, as far behind the plate as the first is before it.

    A facet of slope s reflects at a distance of about s z from the mirror's place, a detour of s^2 z; half of
    the facets of GGX have a slope below alpha.
    """
    spot, z = np.array([-0.2, 0.1, 0.0]), 1.2
    corners_m = np.array([[-2.0, -2.0, z], [2.0, -2.0, z], [2.0, 2.0, z], [-2.0, 2.0, z]])
    mirrored_m = np.linalg.norm([*(LASER - spot)[:2], 2 * z])
    of_mirror = ALBEDO * (2 * z / mirrored_m) ** 2 / (np.pi * mirrored_m**2)
    detours_m = np.arange(-0.05, 6, 0.002)
    edges_s = (mirrored_m + detours_m) / C_M_PER_S

    def seen(alpha):
        return plate(alpha, corners_m, edge_m=0.03).transients(LASER[None], spot[None], edges_s)[0]

    missing = []
    for alpha in (0.2, 0.1, 0.05):
        of_lobe = (seen(alpha) - alpha * seen(1.0)) / (1 - alpha)
        first, brightest = np.flatnonzero(of_lobe)[0], of_lobe.argmax()
        half = np.searchsorted(of_lobe.cumsum(), of_mirror / 2)
        assert detours_m[first] == pytest.approx(0, abs=0.003)
        assert detours_m[brightest] == pytest.approx(0, abs=0.003)
        assert detours_m[half] == pytest.approx(alpha**2 * z, rel=0.05, abs=0.003)
        missing.append(1 - of_lobe.sum() / of_mirror)
    assert 0 < 2 * missing[2] < missing[1] < missing[0] / 2
    assert missing[2] < 0.02
