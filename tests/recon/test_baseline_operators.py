"""The baselines' operators against their definitions, term by term, and against each other."""

import numpy as np
import pytest

from recon.aperture import LatticeAxis
from recon.capture import C_M_PER_S, ArrayHistograms, Capture
from recon.grid import VoxelGrid
from recon.solvers.classic import ellipsoids, fk
from recon.solvers.classic.interpolate import LateralAxis, read_voxels
from recon.solvers.classic.lct import LightCone
from recon.solvers.classic.resample import ConfocalLattice, confocal_record
from recon.window import Window

UNFADED = Window(fall_s=0)


def lateral(count, pitch_m, extra=0):
    wall = LatticeAxis(-(count - 1) / 2 * pitch_m, pitch_m, count)
    ends = wall.coordinates_m[[0, -1]] + [-extra * pitch_m, extra * pitch_m]
    return LateralAxis.covering(wall, ends)


@pytest.mark.parametrize("detectors", [1, 30])
def test_backprojection_is_the_adjoint_of_projection(detectors):
    random = np.random.default_rng(3)
    laser_m = random.uniform(-0.4, 0.4, (30, 3)) * [1, 1, 0.1]
    detector_m = random.uniform(-0.4, 0.4, (detectors, 3)) * [1, 1, 0.1]
    first_bin_s = random.uniform(0, 2e-9, 30)
    grid = VoxelGrid(np.linspace(-0.3, 0.3, 7), np.linspace(-0.2, 0.2, 5), np.linspace(0.3, 0.8, 6))
    # 200 ps is 6 cm of path, more than a voxel: bins are not summed. Some voxels' delays are off the record.
    bins, width_s = 20, 200e-12
    counts = random.normal(size=(30, bins)).astype(np.float32)
    volume = random.normal(size=grid.shape).astype(np.float32)
    capture = Capture(ArrayHistograms(counts, 13), width_s, first_bin_s, laser_m, detector_m)
    forward = ellipsoids.project(volume, grid, laser_m, detector_m, bins, width_s, first_bin_s)
    back = ellipsoids.backproject(capture, grid, UNFADED)
    scale = float(np.linalg.norm(forward) * np.linalg.norm(counts))
    # Delays in single precision: 1e-7 of 20 bins' position each, of 4200 terms of random sign.
    assert np.vdot(forward, counts) == pytest.approx(np.vdot(volume, back), abs=1e-5 * scale)
    # And both are the definition.
    z, y, x = np.meshgrid(grid.z_m, grid.y_m, grid.x_m, indexing="ij")
    voxels = np.stack([x, y, z], axis=-1)
    expected = np.zeros(grid.shape)
    for p in range(30):
        path_m = np.linalg.norm(voxels - laser_m[p], axis=-1)
        path_m += np.linalg.norm(voxels - detector_m[p % detectors], axis=-1)
        centres_s = first_bin_s[p] + (np.arange(-1, bins + 1) + 0.5) * width_s
        expected += np.interp(path_m / C_M_PER_S, centres_s, np.pad(counts[p], 1))
    np.testing.assert_allclose(back, expected, atol=1e-4)


def test_counts_are_summed_by_groups_of_bins_that_voxels_can_tell():
    """Fine bins give a voxel all photons of its depth, not those of one bin."""
    spots = np.zeros((1, 3))
    counts = np.ones((1, 4000), np.uint16)
    capture = Capture(ArrayHistograms(counts), 1e-12, np.zeros(1), spots, spots)
    grid = VoxelGrid(np.zeros(1), np.zeros(1), np.arange(0.2, 0.3, 0.02))
    # 2 cm of path is 66.7 bins.
    np.testing.assert_allclose(ellipsoids.backproject(capture, grid, UNFADED), 66)


def test_laplacian_filter_is_the_second_difference_along_depth():
    spots = np.zeros((1, 3))
    # Counts that grow as the square of the bin: r^2 on the axis, whose second difference is constant and
    # upwards; the negative of it is cut.
    path_m = (np.arange(1000) + 0.5) * C_M_PER_S * 10e-12
    grid = VoxelGrid(np.zeros(1), np.zeros(1), np.arange(0.2, 1.0, 0.05))
    for sign in (1, -1):
        counts = (sign * 1e4 * (path_m / 2) ** 2)[None]
        capture = Capture(ArrayHistograms(counts), 10e-12, np.zeros(1), spots, spots)
        group = int(0.05 / (C_M_PER_S * 10e-12))
        sharp = ellipsoids.laplacian_filtered(capture, grid, UNFADED)
        expected = 0 if sign > 0 else 2e4 * 0.05**2 * group
        # Straight lines between groups of 4.8 cm of path change r^2 by up to a quarter of (2.4 cm)^2.
        np.testing.assert_allclose(sharp, expected, atol=4 * 1e4 * 0.024**2 / 4 * group)


def cone_data(volume, y, x, step_m2, fine=6):
    """Sum over voxels and wall points, each cell cut into `fine` parts across and along u."""
    steps = len(volume)
    data = np.zeros((steps, y.wall.stop - y.wall.start, x.wall.stop - x.wall.start))
    parts = (np.arange(fine) + 0.5) / fine
    dx, dy, du = np.meshgrid((parts - 0.5) * x.pitch_m, (parts - 0.5) * y.pitch_m, parts, indexing="ij")
    for j in range(data.shape[1]):
        for i in range(data.shape[2]):
            for b in range(y.count):
                for a in range(x.count):
                    across = ((a - x.wall.start - i) * x.pitch_m + dx) ** 2
                    across = (across + ((b - y.wall.start - j) * y.pitch_m + dy) ** 2) / step_m2 + du
                    for u in np.flatnonzero(volume[:, b, a]):
                        v = np.floor(across + u).astype(int).ravel()
                        share = np.bincount(v[v < steps], minlength=steps) / fine**3
                        data[:, j, i] += volume[u, b, a] * share
    return data


def smooth_volume(steps, y, x, radius):
    """A ball of Gaussian fall-off, `radius` cells."""
    u, b, a = np.ogrid[:steps, : y.count, : x.count]
    distance = ((u - 0.4 * steps) / radius) ** 2 + ((b - y.count / 2) / radius) ** 2
    return np.exp(-(distance + ((a - x.count / 2.2) / radius) ** 2) / 2).astype(np.float32)


def test_light_cone_is_its_definition():
    y, x = lateral(4, 0.06), lateral(5, 0.05, extra=1)
    cone = LightCone(y, x, 30, 0.01)
    volume = smooth_volume(30, y, x, 1.5)
    volume[volume < 0.05] = 0
    data = cone.forward(volume)
    expected = cone_data(volume, y, x, 0.01)
    # Left out is s^2 of (x + s)^2, at most (pitch/2)^2 = 0.09 steps on each axis of a cone that is smooth
    # over 1.5 steps: 0.09/1.5.
    assert np.abs(data - expected).max() <= 0.06 * expected.max()
    assert data.sum() == pytest.approx(expected.sum(), rel=0.01)


def test_light_cone_and_its_inverse_are_the_identity():
    # A wall without edges (cyclic across), and a record that is long enough for the widest part of each cone:
    # 2 (16/2 0.05 m)^2 / 0.01 m^2 = 32 steps.
    y, x = (LateralAxis(0.0, 0.05, 16, slice(0, 16), 16) for _ in "yx")
    cone = LightCone(y, x, 90, 0.01)
    # At frequency zero of u the cone covers the wall evenly: whatever differs across has no mean along u that
    # could be seen. So: a ball with its second derivative's shape along u, which has none.
    ball = smooth_volume(90, y, x, 2.0)
    volume = 2 * ball - np.roll(ball, 4, axis=0) - np.roll(ball, -4, axis=0)
    volume /= volume.max()
    data = cone.forward(volume)
    # The filter damps a frequency by 1/(SNR |h^|^2), and |h^|^2 of a smooth volume is not far below 1.
    assert np.abs(cone.inverse(data, snr=1e5) - volume).max() <= 1e-4
    # A filter that has been told of more noise gives less contrast, in order.
    peaks = [cone.inverse(data, snr=snr).max() for snr in (0.01, 0.1, 1, 10)]
    assert np.all(np.diff(peaks) > 0)
    assert peaks[-1] < 1


def test_migration_is_its_definition():
    random = np.random.default_rng(4)
    y, x = lateral(3, 0.05), lateral(4, 0.04, extra=1)
    radii, step_m = 16, 0.03
    wave = random.random((3, 4, radii)).astype(np.float32)
    planes = slice(2, 14)
    image = fk.migrate(wave, step_m, y, x, planes)
    k_y, k_x = np.fft.fftfreq(y.length, y.pitch_m), np.fft.fftfreq(x.length, x.pitch_m)
    k_z = np.arange(1, radii) / (2 * radii * step_m)
    k_y, k_x, k_z = np.meshgrid(k_y, k_x, k_z, indexing="ij")
    k = np.sqrt(k_x**2 + k_y**2 + k_z**2)
    in_steps = k * 2 * radii * step_m
    kept = (in_steps >= 3) & (in_steps <= radii - 3)
    spectrum = np.zeros(k.shape, complex)
    for j in range(3):
        for i in range(4):
            for n in range(radii):
                turns = k_y * j * y.pitch_m + k_x * (i + 1) * x.pitch_m + k * (n + 0.5) * step_m
                spectrum += wave[j, i, n] * np.exp(-2j * np.pi * turns)
    spectrum *= kept * k_z / k
    expected = np.zeros(image.shape)
    for m in range(planes.start, planes.stop):
        for b in range(y.count):
            for a in range(x.count):
                turns = k_y * b * y.pitch_m + k_x * a * x.pitch_m + k_z * m * step_m
                total = (spectrum * np.exp(2j * np.pi * turns)).sum() / (y.length * x.length * 2 * radii)
                expected[m - planes.start, b, a] = abs(total) ** 2
    # The window's error, 1e-5 of a spectrum in which all samples add up, and single precision.
    assert np.abs(image - expected).max() <= 1e-4 * expected.max()


def test_shells_conserve_counts_and_moveout():
    """A count at the path sqrt(4 r^2 + b^2) comes into the shell of r, whatever the bins' edges."""
    laser_m = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.6, 0.0, 0.0]])
    detector_m = np.array([[0.3, 0.0, 0.0]])
    width_s = 5e-12
    edges_m = np.linspace(0.1, 1.0, 31)
    shell = 17
    r = (edges_m[shell] + edges_m[shell + 1]) / 2
    path_m = np.sqrt(4 * r**2 + np.array([0.3, 0, 0.3]) ** 2)
    first_bin_s = np.array([0.1e-9, 0.0, 0.33e-9])
    counts = np.zeros((3, 1200), np.uint32)
    counts[np.arange(3), ((path_m / C_M_PER_S - first_bin_s) / width_s).astype(int)] = 40
    capture = Capture(ArrayHistograms(counts, 2), width_s, first_bin_s, laser_m, detector_m)
    lattice = ConfocalLattice.of(capture, "test")
    assert lattice.aperture.x.pitch_m == pytest.approx(0.15)
    record = confocal_record(capture, lattice, UNFADED, edges_m)
    expected = np.zeros((1, 3, 30))
    expected[0, :, shell] = 40
    np.testing.assert_allclose(record, expected, atol=1e-4)


def test_moveout_is_short_by_what_is_said():
    """Off the midpoint's axis the radius is short by b^2 cos^2(theta)/(8 r), to the next order in b/r."""
    laser_m, detector_m = np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]]), np.array([[-0.1, 0.0, 0.0]])
    middle_m, b = np.zeros(3), 0.2
    edges_m = np.arange(0.5, 1.5, 1e-4)
    for angle in (0.0, 0.4, 0.8):
        point = 0.9 * np.array([np.sin(angle), 0, np.cos(angle)])
        counts = np.zeros((2, 10000), np.uint32)
        path_m = np.linalg.norm(laser_m[0] - point) + np.linalg.norm(detector_m[0] - point)
        counts[0, int(path_m / C_M_PER_S / 1e-12)] = 1
        capture = Capture(ArrayHistograms(counts), 1e-12, np.zeros(1), laser_m, detector_m)
        record = confocal_record(capture, ConfocalLattice.of(capture, "test"), UNFADED, edges_m)[0, 1]
        r = np.average((edges_m[1:] + edges_m[:-1]) / 2, weights=record)
        short_m = b**2 * np.sin(angle) ** 2 / (8 * np.linalg.norm(point - middle_m))
        # A bin is 0.15 mm of radius, a shell 0.1 mm; the next order is (b/2r)^2 of 2.9 mm.
        assert 0.9 - r == pytest.approx(short_m, abs=0.15e-3)


def test_voxels_are_means_over_their_extent():
    random = np.random.default_rng(5)
    y, x = lateral(3, 0.1), lateral(4, 0.1)
    edges_m = np.array([0.0, 0.1, 0.15, 0.2, 0.4])
    values = random.random((4, 3, 4)).astype(np.float32)
    same = VoxelGrid(x.start_m + 0.1 * np.arange(4), y.start_m + 0.1 * np.arange(3), np.array([0.05, 0.15]))
    read = read_voxels(values, edges_m, y, x, same)
    np.testing.assert_allclose(read[0], values[0], rtol=1e-5)
    np.testing.assert_allclose(read[1], (values[1] + values[2]) / 2, rtol=1e-5)
    between = VoxelGrid(same.x_m[:1] + 0.025, same.y_m[:1], np.array([0.3]))
    np.testing.assert_allclose(
        read_voxels(values, edges_m, y, x, between)[0, 0, 0],
        0.75 * values[3, 0, 0] + 0.25 * values[3, 0, 1],
        rtol=1e-5,
    )
