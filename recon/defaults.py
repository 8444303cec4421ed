"""Sensible choices for a capture, with their reasons, and warnings about choices that are not."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, floor, inf, isfinite, log10, pi

import numpy as np
from numpy.typing import NDArray

from recon.aperture import Aperture, LatticeAxis, recognise
from recon.capture import C_M_PER_S, Capture
from recon.errors import GeometryError, ReachError
from recon.grid import VoxelGrid
from recon.sampling import distance_limits_m
from recon.wave import ContinuousWave, Light, VirtualPulse

#: Full width at half maximum of a Gaussian in standard deviations.
FWHM_SIGMAS = 2.355
#: Least wavelength in spacings of positions. A pulse of two cycles has a wide band, whose ghosts do not come
#: together: below two spacings (four where laser and detector move together), they are a haze.
SPACINGS, SPACINGS_CONFOCAL = 1.0, 3.0
#: Positions whose haze is faint enough for that; of fewer, the wavelength is longer by the root.
MANY_POSITIONS = 1000
#: Wavelength in the shortest that the instrument's response passes: two thirds of the band pass well.
RESPONSES = 1.5
#: Response that is taken where none is known: laser, detector and timing of the usual rig.
USUAL_RESPONSE_S = 65e-12
#: A rendering has neither response nor noise. Then it is cost that decides: half the wavelength is four times
#: the work. A wave as long as the usual instrument's is cheap enough on any wall, and none longer is wanted.
SPACINGS_RENDERED, CHEAP_M = 2.0, 0.04
#: Where no response is known, so many wavelengths are to fit on the wall.
WAVELENGTHS = 12.0
#: Fewest wavelengths across the wall with which anything is told apart.
MIN_WAVELENGTHS = 4.0
#: Part of a lattice that must be filled for its pitch to be the spacing.
MIN_FILLED = 0.5
#: Part of a sub-grid's points that make it complete; some are left out around the detector's spot.
COMPLETE = 0.9
#: Where positions are denser on one side, because a round was not finished, they are at most twice as many as
#: the complete sub-grid has: its spacing is sqrt(2) times the side of the square that each has, and a little.
UNEVEN = 1.5
#: Nearest object in the paper's rooms, and the farthest depth that is imaged unasked.
NEAR_M, FAR_M = 0.5, 3.0


@dataclass(frozen=True)
class Choice:
    """A value and the reason for it."""

    value: float
    reason: str


def spacing_m(capture: Capture) -> float:
    """Return the spacing that sets the aliasing: that of the finer aperture, where pairs have two.

    That is the coarser pitch of a regular grid, on a plane of any depth; for scattered positions, and for few
    points of a grid, the side of the square that each has to itself, sqrt(area / positions): random ones
    crowd, and the distance of nearest neighbours, half of that, would promise too much. Spots that are lit
    more than once, with several detectors, count once. Of a scan from coarse to fine that was not finished it
    is the spacing of the finest sub-grid that is complete.
    """
    return _spacing_of_m(capture.by_its_finer_aperture().laser_m)


def _spacing_of_m(spots_m: NDArray[np.float64]) -> float:
    spots_m = np.unique(np.round(spots_m, 4), axis=0)
    try:
        aperture = recognise(spots_m - [0, 0, (spots_m[:, 2].min() + spots_m[:, 2].max()) / 2])
    except GeometryError:
        return _side_of_each_m(spots_m)
    pitch_m = max(aperture.x.pitch_m, aperture.y.pitch_m)
    if len(spots_m) >= COMPLETE * aperture.x.count * aperture.y.count:
        return pitch_m
    side_m = _side_of_each_m(spots_m)
    for spacings in _complete_spacings(aperture):
        if spacings * pitch_m < UNEVEN * side_m:
            return float(spacings * pitch_m)
    if len(spots_m) < MIN_FILLED * aperture.x.count * aperture.y.count:
        return side_m
    return pitch_m


def _complete_spacings(aperture: Aperture) -> Iterator[float]:
    """Yield the spacings, in the lattice's, of the sub-grids of it that are complete, from fine to coarse.

    A scan from coarse to fine has, in turn, a square lattice of every 1st, 2nd, 4th or 8th point, and that
    with the centres of its squares, whose points have sqrt(2) less to themselves.
    """
    there = np.zeros((aperture.y.count, aperture.x.count), bool)
    there[aperture.row, aperture.column] = True
    for stride in (1, 2, 4, 8):
        corners, half = there[::stride, ::stride], stride // 2
        centres = there[half::stride, half::stride]
        if half and centres.size and min(corners.mean(), centres.mean()) >= COMPLETE:
            yield stride / 2**0.5
        if corners.mean() >= COMPLETE:
            yield stride


def shortest_wavelength_m(response_fwhm_s: float) -> float:
    """Return the wavelength that a timing response of this full width at half maximum still passes.

    A Gaussian response of standard deviation s damps the carrier by exp(-(omega s)^2/2); omega s = 2 leaves
    0.14 of it. That is lambda = pi c s: 2.6 cm for 65 ps.
    """
    return pi * C_M_PER_S * response_fwhm_s / FWHM_SIGMAS


def _side_of_each_m(spots_m: NDArray[np.float64]) -> float:
    """Return sqrt(area / positions), of the hull as seen from the front; of the distances, if it has none."""
    from scipy.spatial import ConvexHull, KDTree, QhullError

    try:
        hull = ConvexHull(spots_m[:, :2])
    except (QhullError, ValueError):
        nearest, _ = KDTree(spots_m).query(spots_m, k=2)
        return float(np.median(nearest[:, 1]))
    # The hull passes through the outermost positions, which have half of their square outside.
    count, rim_m = len(spots_m), hull.area
    half_rim_m = rim_m / 2
    return float((half_rim_m + np.sqrt(half_rim_m**2 + 4 * (count - 1) * hull.volume)) / (2 * (count - 1)))


def _slowest_response_s(extent_m: float) -> float:
    """Return the response whose shortest wavelength a wall of this extent holds `MIN_WAVELENGTHS` times."""
    return extent_m / MIN_WAVELENGTHS * FWHM_SIGMAS / (pi * C_M_PER_S)


def wavelength(capture: Capture, response_fwhm_s: float | None = None, *, rendered: bool = False) -> Choice:
    """Choose a wavelength from spacing and number of positions, and from the instrument's response.

    The reason names the choice that is next worth a try.

    Parameters
    ----------
    capture
        Its positions and its bins.
    response_fwhm_s
        Full width at half maximum; None where unknown.
    rendered
        Whether the record holds expectation values, without noise.
    """
    spots_m = np.unique(np.round(capture.by_its_finer_aperture().laser_m, 4), axis=0)
    pitch_m, few = spacing_m(capture), min(2.0, max(1.0, (MANY_POSITIONS / len(spots_m)) ** 0.5))
    spacings = SPACINGS_CONFOCAL if capture.confocal else SPACINGS
    if rendered and not capture.confocal:
        spacings = max(SPACINGS, min(SPACINGS_RENDERED, CHEAP_M / pitch_m))
    spaced = Choice(
        few * spacings * pitch_m,
        f"for {len(spots_m):,} positions {pitch_m * 100:.3g} cm apart",
    )
    if rendered and response_fwhm_s is None:
        response_fwhm_s = capture.bin_width_s
    if response_fwhm_s is not None:
        passed = Choice(
            RESPONSES * shortest_wavelength_m(response_fwhm_s),
            f"for an instrument response of {response_fwhm_s * 1e12:.0f} ps",
        )
    else:
        response_s = max(USUAL_RESPONSE_S, capture.bin_width_s)
        fitting_m = float(np.ptp(spots_m, axis=0).max()) / WAVELENGTHS
        passed = Choice(
            min(RESPONSES * shortest_wavelength_m(response_s), fitting_m),
            "since no instrument response is known",
        )
    return _rounded(max(spaced, passed, key=lambda choice: choice.value))


def _rounded(choice: Choice) -> Choice:
    """Round up to a quarter of the first digit, and add what else to try."""
    quarter_m = 0.25 * 10.0 ** floor(log10(choice.value))
    value_m = float(f"{quarter_m * ceil(choice.value / quarter_m * (1 - 1e-3)):.3g}")
    return Choice(value_m, f"{choice.reason}; {value_m * 70:.2g} cm may show more, with more noise")


def voxels(
    capture: Capture,
    pulse: VirtualPulse,
    *,
    width_m: float | None = None,
    height_m: float | None = None,
    voxel_m: float | None = None,
    depth_m: tuple[float, float, float] | None = None,
) -> VoxelGrid:
    """Choose voxels: what is not asked for is as wide and as finely spaced as the wall.

    Where the pitch is a whole number of the wall's, voxels are put on the wall's lattice (a shift of half a
    wall pitch at most), which is the fastest for the RSD solver and needs no interpolation.

    Parameters
    ----------
    capture
        Its wall and its record.
    pulse
        Planes are half a wavelength apart by default.
    width_m, height_m, voxel_m, depth_m
        As in `VoxelGrid.from_spec`; None chooses.

    Raises
    ------
    ReachError
        If depths go on to where all light comes after the record's end, twice as far as its last light.
    """
    if depth_m is not None:
        _check_reach(capture, *depth_m[:2])
    low, high = extent(capture)
    pitch_m = spacing_m(capture)
    voxel_m = _on_the_lattice_m(capture, pitch_m) if voxel_m is None else voxel_m
    width_m = float(high[0] - low[0]) + pitch_m if width_m is None else width_m
    height_m = float(high[1] - low[1]) + pitch_m if height_m is None else height_m
    grid = VoxelGrid.from_spec(
        width_m,
        height_m,
        voxel_m,
        depth_m or (*depths(capture), pulse.wavelength_m / 2),
        (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2),
    )
    try:
        aperture = recognise(capture.laser_m)
    except GeometryError:
        return grid
    return VoxelGrid(
        _snapped(grid.x_m, voxel_m, aperture.x), _snapped(grid.y_m, voxel_m, aperture.y), grid.z_m
    )


def _check_reach(capture: Capture, near_m: float, far_m: float) -> None:
    """Refuse depths far beyond the record: light of a depth z takes 2 z / c at least."""
    end_m = C_M_PER_S * (float(capture.first_bin_s.max()) + capture.bins * capture.bin_width_s)
    if near_m < end_m / 2 and end_m < far_m < inf:  # where all is beyond, imaging itself refuses
        raise ReachError(
            "volume",
            f"depths to {far_m:g} m",
            f"the last light of the record comes from {end_m / 2:.2f} m",
            f"End --depth there: FROM:{floor(end_m / 2 * 100) / 100:g}m:STEP.",
        )


def _on_the_lattice_m(capture: Capture, spacing_m: float) -> float:
    """Return the spacing, or, if the wall is a lattice, the greatest whole number of its pitch below it."""
    try:
        aperture = recognise(capture.laser_m)
    except GeometryError:
        return spacing_m
    pitch_m = max(aperture.x.pitch_m, aperture.y.pitch_m)
    return max(1, floor(spacing_m / pitch_m + 1e-6)) * pitch_m


def _snapped(voxels_m: NDArray[np.float64], pitch_m: float, wall: LatticeAxis) -> NDArray[np.float64]:
    """Move an axis onto the wall's lattice if its pitch is a whole number of the wall's."""
    stride = pitch_m / float(wall.pitch_m)
    if (
        not isfinite(stride * len(voxels_m))
        or round(stride) < 1
        or abs(stride - round(stride)) * len(voxels_m) > 0.1
    ):
        return voxels_m
    start = round((voxels_m[0] - wall.start_m) / wall.pitch_m)
    return wall.start_m + wall.pitch_m * (start + round(stride) * np.arange(len(voxels_m), dtype=np.float64))


def extent(capture: Capture) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and the greatest coordinates of the wall that is lit or, by several spots, seen."""
    spots_m = np.vstack([capture.laser_m, capture.detector_m]) if capture.round_trip else capture.laser_m
    return spots_m.min(axis=0), spots_m.max(axis=0)


def depths(capture: Capture) -> tuple[float, float]:
    """Choose the nearest and the farthest depth.

    Near: half a metre, or half the wall's width where that is less. Far: three metres, or half of the
    record's longest path.

    Raises
    ------
    GeometryError
        If all positions are one spot.
    """
    low, high = extent(capture)
    if not (high - low).any():
        raise GeometryError(
            "capture",
            "an image",
            f"its positions ({capture.positions:,}) are one spot of the wall",
            "Scan positions across the wall.",
        )
    end_s = float(capture.first_bin_s.min()) + capture.bins * capture.bin_width_s
    far_m = min(FAR_M, end_s * C_M_PER_S / 2)
    near_m = min(NEAR_M, float((high - low)[:2].max()) / 2)
    return (near_m, far_m) if near_m < far_m else (far_m / 2, far_m)


def warnings(
    capture: Capture,
    pulse: VirtualPulse,
    grid: VoxelGrid,
    response_fwhm_s: float | None = None,
    light: Light | None = None,
) -> list[str]:
    """List what will spoil the image, each with its remedy; empty if nothing is known to.

    `light` is the camera's, where that is not the pulse: one frequency has no reach to warn about.
    """
    found = on_one_line(capture)
    pitch_m = spacing_m(capture)
    least = 2 if capture.confocal else 1
    if pulse.wavelength_m < least * pitch_m * (1 - 1e-3):
        found.append(
            f"wavelength {pulse.wavelength_m * 100:.3g} cm is shorter than "
            f"{'twice ' if least > 1 else ''}the spacing of positions, {pitch_m * 100:.3g} cm: "
            "ghosts will appear; use "
            f"{least * pitch_m * 100:.3g} cm or more"
        )
    low, high = extent(capture)
    extent_m = float((high - low).max())
    passed_m = shortest_wavelength_m(response_fwhm_s) if response_fwhm_s else 0.0
    if response_fwhm_s and extent_m < MIN_WAVELENGTHS * passed_m:
        found.append(
            f"no wavelength can image this record: an instrument response of {response_fwhm_s * 1e12:.0f} ps "
            f"blurs away wavelengths below {passed_m * 100:.3g} cm, and the wall of {extent_m * 100:.3g} cm "
            f"is only {extent_m / passed_m:.1f} of them wide, with {MIN_WAVELENGTHS:g} needed; "
            f"scan a wall of {MIN_WAVELENGTHS * passed_m:.2g} m, or use a response of "
            f"{_slowest_response_s(extent_m) * 1e12:.0f} ps or less"
        )
    elif response_fwhm_s and pulse.wavelength_m < passed_m * (1 - 1e-3):
        found.append(
            f"an instrument response of {response_fwhm_s * 1e12:.0f} ps blurs a wavelength of "
            f"{pulse.wavelength_m * 100:.3g} cm away; use {passed_m * 100:.3g} cm or more"
        )
    elif extent_m < MIN_WAVELENGTHS * pulse.wavelength_m:
        found.append(
            f"the wall is only {extent_m / pulse.wavelength_m:.1f} wavelengths wide: at a depth of its own "
            f"width nothing smaller than {0.61 * pulse.wavelength_m * 100:.3g} cm is resolved"
        )
    if isinstance(light, ContinuousWave):
        return found
    return found + dark_parts(capture, grid)


def on_one_line(capture: Capture) -> list[str]:
    """Say so if the spots of the wall that is lit or seen are within a thousandth of a line."""
    spots_m = np.vstack([capture.laser_m, capture.detector_m]) if capture.round_trip else capture.laser_m
    spread = np.linalg.svd(np.unique(spots_m, axis=0) - spots_m.mean(axis=0), compute_uv=False)
    if not spread[0] or spread[1:].max(initial=0.0) >= 1e-3 * spread[0]:
        return []
    return [
        "all positions are on one line: all that is at the same distance from it looks alike, so that "
        "depth and the direction across the line cannot be told apart; scan several lines"
    ]


def shortest_path_m(capture: Capture, grid: VoxelGrid) -> float:
    """Bound the shortest path as `recon.sampling.path_limits_m`, but axis by axis: a volume may be large."""
    if capture.round_trip:
        nearest_m = 0.0
        ends = [capture.laser_m, capture.laser_m if capture.confocal else capture.detector_m]
    else:
        axes = zip((grid.x_m, grid.y_m, grid.z_m), capture.detector_m[0], strict=True)
        nearest_m = float(np.sqrt(sum(((axis_m - at_m) ** 2).min() for axis_m, at_m in axes)))
        ends = [capture.laser_m]
    return nearest_m + sum(distance_limits_m(spots_m, grid)[0] for spots_m in ends)


def dark_parts(capture: Capture, grid: VoxelGrid) -> list[str]:
    """List the voxels of which the record holds no light."""
    found = []
    shortest_m = shortest_path_m(capture, grid)
    begin_m = float(capture.first_bin_s.max()) * C_M_PER_S
    end_m = (float(capture.first_bin_s.min()) + capture.bins * capture.bin_width_s) * C_M_PER_S
    if shortest_m < begin_m:
        found.append(
            f"the record begins at {begin_m:.2f} m of path, the volume at {shortest_m:.2f} m: its near part "
            f"is dark; begin at a depth of {begin_m / 2:.2f} m"
        )
    if shortest_m > end_m or 2 * float(grid.z_m[-1]) > end_m * (1 + 1e-9):
        found.append(
            f"the record ends at {end_m:.2f} m of path, the farthest plane, seen straight on, is at "
            f"{2 * float(grid.z_m[-1]):.2f} m: it is dark; end at a depth of {end_m / 2:.2f} m or take a "
            "longer record"
        )
    return found
