"""Defaults and warnings, at the paper's figures and beyond them."""

import numpy as np
import pytest

from recon import defaults
from recon.capture import ArrayHistograms, Capture
from recon.errors import GeometryError, ParameterError
from recon.grid import VoxelGrid
from recon.wave import VirtualPulse
from support.hidden_points import wall


def capture(laser_m, confocal=False, bins=6000, bin_width_s=4e-12, first_bin_s=0.0):
    counts = np.broadcast_to(np.uint16(0), (len(laser_m), bins))
    spots = laser_m if confocal else np.zeros((1, 3))
    return Capture(ArrayHistograms(counts), bin_width_s, np.array([first_bin_s]), laser_m, spots)


PAPER = capture(wall(180, 130, 0.01))


def test_the_papers_wavelength():
    choice = defaults.wavelength(PAPER, response_fwhm_s=65e-12)
    assert choice.value == pytest.approx(0.04)
    assert "response of 65 ps" in choice.reason


def test_a_coarse_grid_asks_for_a_longer_wave_the_longer_the_fewer_positions():
    """Ghosts of a wide band do not come together: a haze, the fainter the more positions there are."""
    coarse, few = capture(wall(60, 44, 0.05)), capture(wall(12, 12, 0.05))
    assert defaults.wavelength(coarse, 65e-12).value == pytest.approx(0.05)
    assert defaults.wavelength(few, 65e-12).value == pytest.approx(0.1)
    assert "144 positions 5 cm apart" in defaults.wavelength(few, 65e-12).reason
    # laser and detector together sample a wave that is half as long
    assert defaults.wavelength(capture(wall(60, 44, 0.05), True), 65e-12).value == pytest.approx(0.15)


def test_a_rendering_is_limited_by_its_positions_alone():
    assert defaults.wavelength(PAPER, rendered=True).value == pytest.approx(0.02)
    assert "23,400 positions 1 cm apart" in defaults.wavelength(PAPER, rendered=True).reason
    # a response that is known is there, noise or not
    assert defaults.wavelength(PAPER, 65e-12, rendered=True).value == pytest.approx(0.04)


@pytest.mark.parametrize("towards", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.6, 0.8, 0.0)])
def test_positions_on_one_line_are_warned_about(towards):
    line = capture(np.linspace(-0.5, 0.5, 30)[:, None] * np.array(towards), True)
    pulse = VirtualPulse(0.1)
    grid = VoxelGrid.from_spec(1.0, 1.0, 0.1, (0.5, 1.0, 0.1))
    assert any("on one line" in one for one in defaults.warnings(line, pulse, grid))
    assert not any("on one line" in one for one in defaults.warnings(PAPER, pulse, grid))


@pytest.mark.parametrize("positions", [1, 3])
def test_one_spot_makes_no_image(positions):
    with pytest.raises(GeometryError, match="are one spot of the wall"):
        defaults.depths(capture(np.zeros((positions, 3))))


def test_one_voxel_stays_where_it_was_asked_for():
    """It is smaller than the wall's spacing: on the lattice it would be half a spacing away."""
    grid = defaults.voxels(
        capture(wall(24, 24, 0.04)), VirtualPulse(0.1), width_m=0.01, height_m=0.01, voxel_m=0.01
    )
    np.testing.assert_allclose([*grid.x_m, *grid.y_m], 0.0, atol=1e-12)


def test_the_finer_aperture_decides():
    """Few lasers by many pixels: light takes the same paths both ways."""
    lasers, pixels = wall(2, 2, 1.6), wall(32, 32, 0.05)
    pairs = np.repeat(lasers, len(pixels), axis=0), np.tile(pixels, (len(lasers), 1))
    counts = ArrayHistograms(np.broadcast_to(np.uint16(0), (len(pairs[0]), 1000)))
    taken = Capture(counts, 16e-12, np.zeros(1), *pairs)
    assert defaults.spacing_m(taken) == pytest.approx(0.05)
    pulse = VirtualPulse(defaults.wavelength(taken, 65e-12).value)
    grid = defaults.voxels(taken.by_its_finer_aperture(), pulse)
    assert pulse.wavelength_m == pytest.approx(0.05)
    assert len(grid.x_m) == 33  # as wide as the lasers are apart, and a voxel
    np.testing.assert_array_equal(taken.by_its_finer_aperture().laser_m, pairs[1])
    one = Capture(counts, 16e-12, np.zeros(1), np.tile(lasers[:1], (len(pairs[0]), 1)), pairs[1])
    assert one.by_its_finer_aperture().detector_m.shape == (1, 3)
    assert not one.by_its_finer_aperture().round_trip


def test_a_slow_response_asks_for_a_longer_wave():
    choice = defaults.wavelength(PAPER, response_fwhm_s=750e-12)
    # The response's standard deviation is 318 ps; the shortest wave that passes is damped by exp(-2), one
    # and a half times as long by exp(-2 / 1.5^2).
    damping = np.exp(-((2 * np.pi * 299792458 / choice.value * 750e-12 / 2.355) ** 2) / 2)
    assert damping == pytest.approx(np.exp(-2 / 1.5**2), rel=0.03)
    assert "750 ps" in choice.reason


def test_spacing_of_scattered_positions():
    laser_m = wall(40, 40, 0.02)
    laser_m[:, :2] += np.random.default_rng(0).uniform(-4e-3, 4e-3, (1600, 2))
    assert defaults.spacing_m(capture(laser_m)) == pytest.approx(0.018, abs=0.003)


def test_default_voxels_are_the_walls():
    grid = defaults.voxels(PAPER, VirtualPulse(0.04))
    assert grid.shape == (126, 130, 180)
    np.testing.assert_allclose(grid.x_m, np.unique(PAPER.laser_m[:, 0]), atol=1e-9)
    assert (grid.z_m[0], grid.z_m[-1]) == pytest.approx((0.5, 3.0))


def test_asked_voxels_go_on_the_lattice_where_they_can():
    grid = defaults.voxels(
        PAPER, VirtualPulse(0.04), width_m=0.5, height_m=0.3, voxel_m=0.02, depth_m=(1, 2, 0.5)
    )
    assert grid.shape == (3, 15, 25)
    steps = (grid.x_m + 0.895) / 0.01
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert abs(grid.x_m.mean()) <= 0.005 + 1e-9
    free = defaults.voxels(
        PAPER, VirtualPulse(0.04), width_m=0.5, height_m=0.3, voxel_m=0.015, depth_m=(1, 2, 0.5)
    )
    assert np.diff(free.x_m) == pytest.approx(0.015)
    assert free.x_m.mean() == pytest.approx(0, abs=1e-12)


def test_depths_stay_inside_record_and_room():
    assert defaults.depths(capture(wall(64, 64, 0.4 / 63), True, 512, 16e-12)) == pytest.approx(
        (0.2, 1.228), abs=1e-3
    )
    assert defaults.depths(capture(wall(64, 64, 0.03), True, 15000)) == (0.5, 3.0)
    near, far = defaults.depths(capture(wall(64, 64, 0.03), True, 100, 4e-12))
    assert 0 < near < far <= 0.06


def test_warns_of_what_spoils_the_image():
    grid = VoxelGrid.from_spec(1.8, 1.3, 0.01, (0.5, 3.0, 0.02))
    assert defaults.warnings(PAPER, VirtualPulse(0.04), grid, 65e-12) == []
    (short,) = defaults.warnings(PAPER, VirtualPulse(0.009), VoxelGrid.from_spec(1, 1, 0.1, (0.5, 1, 0.1)))
    assert "shorter than the spacing" in short
    confocal = capture(wall(180, 130, 0.01), confocal=True)
    (short,) = defaults.warnings(confocal, VirtualPulse(0.019), VoxelGrid.from_spec(1, 1, 0.1, (0.5, 1, 0.1)))
    assert "use 2 cm or more" in short
    (slow,) = defaults.warnings(
        PAPER, VirtualPulse(0.04), VoxelGrid.from_spec(1, 1, 0.1, (0.5, 1, 0.1)), 2e-10
    )
    assert "200 ps blurs" in slow


def test_warns_of_what_the_record_does_not_reach():
    late = capture(wall(180, 130, 0.01), bins=1000, first_bin_s=5e-9)
    dark, cut = defaults.warnings(late, VirtualPulse(0.04), VoxelGrid.from_spec(1, 1, 0.1, (0.5, 3, 0.1)))
    assert "begin at a depth of 0.75 m" in dark
    assert "the record ends at 2.70 m of path" in cut
    assert "end at a depth of 1.35 m" in cut


@pytest.mark.parametrize("spec", [(0, 1, 0.1, (1, 2, 0.1)), (1, 1, 0, (1, 2, 0.1)), (1, 1, 0.1, (2, 1, 0.1))])
def test_refuses_empty_boxes(spec):
    with pytest.raises(ParameterError, match="near:far:step"):
        VoxelGrid.from_spec(*spec)


def test_spacing_of_random_positions_is_their_share_of_the_wall():
    laser_m = np.random.default_rng(1).uniform(-0.5, 0.5, (2500, 3)) * [1, 1, 0]
    # 2500 squares of 2 cm; the hull of random positions is a little smaller than the wall.
    assert defaults.spacing_m(capture(laser_m)) == pytest.approx(0.02, rel=0.03)
    # Lit once for each of two detectors.
    assert defaults.spacing_m(capture(np.tile(laser_m, (2, 1)))) == pytest.approx(0.02, rel=0.03)
    line = np.array([[0.0, 0, 0], [0.1, 0, 0.01], [0.2, 0, 0.03]])
    assert defaults.spacing_m(capture(line)) == pytest.approx(0.1, rel=0.05)


def test_spacing_of_a_grid_smaller_than_the_coarsest_sub_grid():
    assert defaults.spacing_m(capture(wall(3, 3, 0.2)[1:])) == pytest.approx(0.2, rel=0.2)


def test_a_plane_behind_the_origin_is_a_grid_too():
    assert defaults.spacing_m(capture(wall(20, 20, 0.03) - [0, 0, 0.05])) == pytest.approx(0.03)


@pytest.mark.parametrize("bins", [500, 2000, 6000])
def test_the_depths_that_the_program_chose_are_not_warned_of(bins):
    taken = capture(wall(64, 64, 0.02), confocal=True, bins=bins)
    pulse = VirtualPulse(0.08)
    assert not [
        one for one in defaults.warnings(taken, pulse, defaults.voxels(taken, pulse)) if "ends" in one
    ]
    end_m = bins * 4e-12 * 299792458
    for far_m, expected in ((end_m / 2 - 0.001, False), (end_m / 2 + 0.001, True)):
        grid = VoxelGrid(np.zeros(1), np.zeros(1), np.array([0.1, far_m]))
        assert any("record ends" in one for one in defaults.warnings(taken, pulse, grid)) == expected
    aside = VoxelGrid(np.array([9.0]), np.zeros(1), np.array([0.1]))
    assert any("record ends" in one for one in defaults.warnings(taken, pulse, aside))


def test_a_response_too_slow_for_any_wavelength_is_said_with_figures():
    taken = capture(wall(64, 64, 0.0156), confocal=True)
    grid = VoxelGrid.from_spec(1, 1, 0.1, (0.5, 1, 0.1))
    choice = defaults.wavelength(taken, 0.75e-9)
    (why,) = defaults.warnings(taken, VirtualPulse(choice.value), grid, 0.75e-9)
    # pi c 750 ps / 2.355 = 30 cm; a wall of 98.3 cm is 3.3 of those, and needs 1.2 m or 615 ps.
    for figure in ("750 ps", "30 cm", "98.3 cm", "3.3", "1.2 m", "614 ps"):
        assert figure in why
    assert defaults.warnings(taken, VirtualPulse(0.2), grid, 0.4e-9) == []


def test_few_points_of_a_grid_have_the_spacing_of_scattered_ones():
    full = wall(64, 64, 0.02)
    few = full[np.random.default_rng(2).permutation(4096)[:256]]
    assert defaults.spacing_m(capture(few)) == pytest.approx(0.08, rel=0.06)
