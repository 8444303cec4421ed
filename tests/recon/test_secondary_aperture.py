"""A hidden surface as an aperture: objects that the wall sees only by way of it."""

import numpy as np
import pytest

from recon.capture import C_M_PER_S, ArrayHistograms, Capture
from recon.errors import GeometryError, ParameterError, ReachError
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.secondary_aperture import image_from, lamp_paths_m, propagated
from recon.wave import VirtualPulse
from simulators.scenes import Mesh, Scene
from simulators.transport.extra_bounces import Interreflections
from simulators.transport.light_paths import transients
from simulators.transport.patches import tessellate
from simulators.transport.three_bounces import ThreeBounces
from simulators.transport.visibility import occluders
from support.hidden_points import wall

BIN_S = 32e-12
PULSE = VirtualPulse(0.12)
LASER_M = wall(24, 24, 0.06)
DETECTOR_M, ASIDE_M = np.zeros((1, 3)), np.array([[-0.7, 0.0, 0.0]])


def plane(z_m, size_m, step_m):
    """Return points spread over a square that faces the wall."""
    count = round(size_m / step_m)
    return wall(count, count, step_m) + np.array([0, 0, z_m])


def voxels(x_m, z_m):
    """Return points (V, 3) of the horizontal plane through the wall's middle."""
    z, x = np.meshgrid(z_m, x_m, indexing="ij")
    return np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])


def seen_from_plane(point_m, plane_m, lit_by_surface):
    """Return a capture of light that comes from a point by way of each of a plane's points."""
    lamp_m = lamp_paths_m(ASIDE_M[0], plane_m, point_m[None], lit_by_surface)[0]
    legs_m = np.linalg.norm(LASER_M[:, None] - plane_m, axis=2) + np.linalg.norm(plane_m - point_m, axis=1)
    at = (lamp_m + legs_m) / C_M_PER_S / BIN_S - 0.5
    counts = np.zeros((len(LASER_M), int(at.max()) + 40), np.float32)
    rows, low = np.arange(len(LASER_M))[:, None], np.floor(at).astype(int)
    np.add.at(counts, (rows, low), 1 - (at - low))
    np.add.at(counts, (rows, low + 1), at - low)
    return Capture(ArrayHistograms(counts), BIN_S, np.zeros(1), LASER_M, ASIDE_M)


@pytest.mark.parametrize("lit_by_surface", [False, True], ids=["four-bounces", "five-bounces"])
def test_point_is_found_where_it_is(lit_by_surface):
    # Where time tells depths apart, beside the way from lamp to plane, and where the plane mirrors it.
    plane_m, point_m = plane(1.4, 0.8, 0.05), np.array([0.4, 0.0, 0.5])
    capture = seen_from_plane(point_m, plane_m, lit_by_surface)
    places_m = voxels(np.arange(0.0, 0.81, 0.04), np.arange(0.3, 0.71, 0.04))
    field = image_from(plane_m, capture, PULSE, places_m, lit_by_surface=lit_by_surface)
    found_m = places_m[np.abs(field).argmax()]
    # The voxel of the point or its neighbour.
    assert np.abs(found_m - point_m).max() < 0.041


def test_propagation_is_the_same_both_ways():
    random = np.random.default_rng(3)
    ones_m, others_m = random.normal(size=(40, 3)), random.normal(size=(30, 3)) + np.array([0, 0, 9])
    band = PULSE.band(3e-9)

    def draw(count):
        shape = len(band), count
        return (random.normal(size=shape) + 1j * random.normal(size=shape)).astype(np.complex64)

    of_ones, of_others = draw(40), draw(30)
    there, back = propagated(of_ones, ones_m, others_m, band), propagated(of_others, others_m, ones_m, band)
    for f, omega in enumerate(band.frequencies_rad_per_s):
        r_m = np.linalg.norm(others_m[:, None] - ones_m, axis=2)
        exact = np.exp(1j * omega * r_m / C_M_PER_S) / r_m @ of_ones[f]
        # Single precision: 6e-8 for each factor of the turn from the lowest frequency, and for each term.
        tolerance = 6e-8 * (len(band) + 40)
        assert np.linalg.norm(there[f] - exact) < tolerance * np.linalg.norm(exact)
        scale = np.linalg.norm(there[f]) * np.linalg.norm(of_others[f])
        assert abs(there[f] @ of_others[f] - back[f] @ of_ones[f]) < tolerance * scale


def test_lamp_goes_the_shortest_way_over_the_plane():
    spot_m, place_m = np.zeros(3), np.array([[0.4, 0.1, 0.9]])
    mirrored_m = np.array([0.4, 0.1, 2 * 1.5 - 0.9])
    length_m = lamp_paths_m(spot_m, plane(1.5, 1.0, 0.02), place_m, True)[0]
    # Off the mirror point by at most half a step along x and y: (0.01^2 + 0.01^2) (1/1.5 + 1/0.6) / 2 longer.
    assert 0 <= length_m - np.linalg.norm(mirrored_m) < 0.25e-3


def test_what_makes_no_sense_is_refused():
    plane_m, point_m = plane(1.4, 0.4, 0.1), np.array([[0.2, 0.0, 0.8]])
    capture = seen_from_plane(point_m[0], plane_m, False)
    confocal = Capture(capture.histograms, BIN_S, capture.first_bin_s, LASER_M, LASER_M)
    with pytest.raises(GeometryError, match="one detector spot"):
        image_from(plane_m, confocal, PULSE, point_m, lit_by_surface=False)
    with pytest.raises(ParameterError, match="voxels_m of shape"):
        image_from(plane_m, capture, PULSE, point_m[0], lit_by_surface=False)
    with pytest.raises(ReachError, match="the record holds"):
        image_from(plane_m, capture, PULSE, point_m + np.array([0, 0, 30]), lit_by_surface=False)


def sheet(name, z_m, x_m, size_m):
    corners_m = size_m / 2 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + [x_m, 0, z_m]
    return Mesh(name, corners_m, np.array([[0, 1, 2], [0, 2, 3]]))


def rendered(lit, hides):
    """Render five bounces, each patch (legs of 6.25 cm) a cluster of its own."""
    patches, blockers = (
        tessellate(Scene("lit", lit), 0.09),
        occluders(Scene("all", (*lit, *hides)).triangles_m),
    )
    paths = (
        ThreeBounces(patches, blockers, (0.0, 0.0, 0.0)),
        Interreflections(patches, blockers, 5, clusters=10**6).light_paths((0.0, 0.0, 0.0)),
    )
    counts = transients(paths, LASER_M, BIN_S * np.arange(701))
    return Capture(ArrayHistograms(counts), BIN_S, np.zeros(1), LASER_M, DETECTOR_M)


def test_object_that_no_third_bounce_sees_has_a_mirror_image():
    """A square faces a diffuse plane, its back to the wall; only five bounces see it, by way of the plane."""
    mirror, square, back = (
        sheet("plane", 1.5, 0, 1.0),
        sheet("object", 0.8, 0.3, 0.2),
        sheet("back", 0.79, 0.3, 0.24),
    )
    with_it, without = rendered((mirror, square), (back,)), rendered((mirror,), (square, back))
    grid = VoxelGrid(np.arange(0.1, 0.51, 0.04), np.arange(-0.12, 0.13, 0.04), np.arange(2.0, 2.41, 0.04))
    seen, control = (image(capture, PULSE, grid).intensity for capture in (with_it, without))
    z, y, x = np.unravel_index(seen.argmax(), seen.shape)
    assert abs(grid.z_m[z] - (2 * 1.5 - 0.8)) < 0.041  # one voxel
    assert abs(grid.x_m[x] - 0.3) < 0.1 + 0.04  # on the square, or one voxel beside it
    assert abs(grid.y_m[y]) < 0.1 + 0.04
    # Some 10 times at 12 cm; what is there without the object is left of the plane's light of three bounces.
    assert seen.max() > 4 * control.max()
