"""A hidden point is lit by all lasers: what it scatters is seen at once, what goes on when it gets there.

The law: light of two patches, of which each hands the light of the other on, is at the second one after the
time that light takes between them, and not at all where nothing hands it on.
"""

from dataclasses import replace

import numpy as np
import pytest

from recon.capture import C_M_PER_S
from recon.exhaustive import ArrayLaserHistograms, Exhaustive
from recon.grid import VoxelGrid
from recon.imaging import image, plan, planes
from recon.relight import Relit, SeparatingCamera
from recon.wave import VirtualPulse
from recon.window import Window
from simulators.scenes.mesh import Scene
from simulators.scenes.solids import quads_mesh
from simulators.transport.each_with_each import EachWithEach
from simulators.transport.patches import tessellate
from simulators.transport.renderer import Transport
from support.hidden_points import wall

PULSE = VirtualPulse(0.12, 2)
WIDTH_S, BINS = 32e-12, 480
LASERS, PIXELS = wall(6, 6, 0.16), wall(16, 16, 0.06)
#: Two squares of 20 cm, 70 cm apart, turned half towards each other and half towards the wall.
LIT_M, OTHER_M = np.array([-0.33, 0.03, 0.8]), np.array([0.37, 0.03, 0.8])


def square(name, centre_m, inward):
    along, up = np.array([1.0, 0.0, inward]) / 2**0.5 * 0.1, np.array([0.0, 0.1, 0.0])
    corners_m = [centre_m - along - up, centre_m + along - up, centre_m + along + up, centre_m - along + up]
    return quads_mesh(name, np.array([corners_m]))


SCENE = Scene("two", (square("lit", LIT_M, 1.0), square("other", OTHER_M, -1.0)))


@pytest.fixture(scope="module")
def relit():
    """The scene with three bounces of light, and with four."""
    found = {}
    for bounces in (3, 4):
        light = Transport(tessellate(SCENE, 0.06), SCENE.triangles_m, bounces=bounces)
        each = EachWithEach(light, PIXELS)
        counts = np.stack([each.transients(tuple(spot), BINS, WIDTH_S) for spot in LASERS])
        whole = Exhaustive(ArrayLaserHistograms(counts), WIDTH_S, np.zeros((1, 1)), LASERS, PIXELS)
        found[bounces] = Relit(whole, LIT_M)
    return found


def at(relit, point_m, times_s):
    """|U_a(v, t)| at a voxel, by the direct solver."""
    grid = VoxelGrid(*(np.array([one]) for one in point_m))
    camera = SeparatingCamera(np.asarray(times_s) - np.linalg.norm(point_m - LIT_M) / C_M_PER_S)
    problem = replace(plan(relit.outline(), PULSE, grid, camera, Window()), spectra=relit.spectra)
    (plane,) = planes(problem, "direct")
    return np.abs(plane[2:, 0, 0])


def test_light_goes_on_from_the_lit_point_at_the_speed_of_light(relit):
    times_s = 25e-12 * np.arange(-16, 160)
    here = at(relit[4], LIT_M, times_s)
    # the square's nearest part is lit 10 cm / c earlier, less than half a pulse's width of 0.8 ns
    assert abs(times_s[here.argmax()]) < 0.2e-9
    straight_s = np.linalg.norm(OTHER_M - LIT_M) / C_M_PER_S
    around = np.abs(times_s - straight_s) < PULSE.half_length_s / 5
    without, there = at(relit[3], OTHER_M, times_s), at(relit[4], OTHER_M, times_s)
    arrived_s = times_s[around][there[around].argmax()]
    # the ways between points of two squares of 20 cm have their middle where those of the middles are
    assert abs(arrived_s - straight_s) < 50e-12
    assert there[around].max() > 0.03 * here.max()
    # without the fourth bounce there is the other square's own light, by lasers a little out of focus
    assert without[times_s > straight_s].max() < 0.2 * there[around].max()
    assert (
        np.abs(there - without)[times_s < straight_s - PULSE.half_length_s].max() < 0.05 * there[around].max()
    )


def test_direct_and_indirect_light_are_separated(relit):
    """The other square is dark at t = 0 but for side lobes, and lit when light from the lit one is there."""
    grid = VoxelGrid(np.array([LIT_M[0], OTHER_M[0]]), np.array([0.03]), np.array([0.8]))
    camera = SeparatingCamera(np.array([2e-9]))
    parts = {}
    for bounces, lit in relit.items():
        problem = replace(plan(lit.outline(), PULSE, grid, camera, Window()), spectra=lit.spectra)
        (plane,) = planes(problem, "rsd")
        parts[bounces] = np.abs(plane[:, 0])
    direct, first, _ = parts[4]
    assert direct[0] == pytest.approx(first[0])  # at the lit point both are one
    assert first[1] > 5 * parts[3][1][1]


def test_spectra_are_those_of_lasers_focused_one_by_one(relit):
    """The first-order image is the double sum over lasers and pixels, term by term."""
    lit = relit[4]
    grid = VoxelGrid(np.array([-0.33, 0.03, 0.39]), np.array([0.03]), np.array([0.8]))
    found = image(lit.outline(), PULSE, grid, taking=lit.spectra, fft=True)
    whole, (block,) = lit.capture, found.depth_blocks
    times_s = (np.arange(BINS) + 0.5) * WIDTH_S
    kept = whole.histograms.counts * Window().end_weights(BINS, WIDTH_S)
    wanted = np.zeros(3, complex)
    for omega, weight in zip(block.band.frequencies_rad_per_s, block.band.weights, strict=True):
        spectrum = kept[:, :, block.bins] @ np.exp(-1j * omega * times_s[block.bins])
        r_l = np.linalg.norm(LASERS - LIT_M, axis=1)
        for number, x_m in enumerate(grid.x_m):
            voxel = np.array([x_m, 0.03, 0.8])
            r_d = np.linalg.norm(PIXELS - voxel, axis=1)
            turns = np.exp(1j * omega * (r_l[:, None] + r_d + np.linalg.norm(voxel - LIT_M)) / C_M_PER_S)
            wanted[number] += weight * (spectrum * turns / (r_l[:, None] * r_d)).sum()
    assert np.abs(found.field[0, 0] - wanted).max() < 1e-3 * np.abs(wanted).max()
