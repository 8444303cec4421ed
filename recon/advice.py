"""Sensible choices for a capture, with their reasons, and warnings about choices that are not."""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from recon.aperture import LatticeAxis, recognise
from recon.capture import C_M_PER_S, Capture
from recon.errors import GeometryError
from recon.grid import VoxelGrid
from recon.reach import path_limits_m
from recon.wave import ContinuousWave, Light, VirtualPulse

#: Full width at half maximum of a Gaussian in standard deviations.
FWHM_SIGMAS = 2.355
#: The paper's trade-off: a wavelength of four spacings.
SPACINGS = 4.0
#: Nearest object in the paper's rooms, and the farthest depth that is imaged unasked.
NEAR_M, FAR_M = 0.5, 3.0


@dataclass(frozen=True)
class Choice:
    """A value and the reason for it."""

    value: float
    reason: str


def spacing_m(capture: Capture) -> float:
    """Return the coarser pitch of a regular grid of positions, or else the median distance of neighbours."""
    try:
        aperture = recognise(capture.laser_m)
    except GeometryError:
        nearest, _ = KDTree(capture.laser_m).query(capture.laser_m, k=2)
        return float(np.median(nearest[:, 1]))
    return max(aperture.x.pitch_m, aperture.y.pitch_m)


def shortest_wavelength_m(response_fwhm_s: float) -> float:
    """Return the wavelength that a timing response of this full width at half maximum still passes.

    A Gaussian response of standard deviation s damps the carrier by exp(-(omega s)^2/2); omega s = 2 leaves
    0.14 of it. That is lambda = pi c s: 2.6 cm for 65 ps.
    """
    return pi * C_M_PER_S * response_fwhm_s / FWHM_SIGMAS


def wavelength(capture: Capture, response_fwhm_s: float | None = None) -> Choice:
    """Choose a wavelength from the spacing of positions, and from the instrument's response where known."""
    pitch_m = spacing_m(capture)
    spaced = Choice(SPACINGS * pitch_m, f"four times the spacing of positions, {pitch_m * 100:.3g} cm")
    if response_fwhm_s is None or shortest_wavelength_m(response_fwhm_s) <= spaced.value:
        return spaced
    return Choice(
        shortest_wavelength_m(response_fwhm_s),
        f"the shortest that an instrument response of {response_fwhm_s * 1e12:.0f} ps passes",
    )


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
    """
    low, high = capture.laser_m.min(axis=0), capture.laser_m.max(axis=0)
    pitch_m = spacing_m(capture)
    voxel_m = voxel_m or pitch_m
    width_m = width_m or float(high[0] - low[0]) + pitch_m
    height_m = height_m or float(high[1] - low[1]) + pitch_m
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
    return VoxelGrid(_snapped(grid.x_m, aperture.x), _snapped(grid.y_m, aperture.y), grid.z_m)


def _snapped(voxels_m: NDArray[np.float64], wall: LatticeAxis) -> NDArray[np.float64]:
    """Move an axis onto the wall's lattice if its pitch is a whole number of the wall's."""
    if len(voxels_m) > 1:
        stride = (voxels_m[1] - voxels_m[0]) / wall.pitch_m
        if round(stride) < 1 or abs(stride - round(stride)) * len(voxels_m) > 0.1:
            return voxels_m
    else:
        stride = 1.0
    start = round((voxels_m[0] - wall.start_m) / wall.pitch_m)
    return wall.start_m + wall.pitch_m * (start + round(stride) * np.arange(len(voxels_m), dtype=np.float64))


def depths(capture: Capture) -> tuple[float, float]:
    """Choose the nearest and the farthest depth.

    Near: half a metre, or half the wall's width where that is less. Far: three metres, or half of the
    record's longest path.
    """
    extent = np.ptp(capture.laser_m, axis=0)
    end_s = float(capture.first_bin_s.min()) + capture.bins * capture.bin_width_s
    far_m = min(FAR_M, end_s * C_M_PER_S / 2)
    near_m = min(NEAR_M, float(max(extent[0], extent[1])) / 2)
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
    found = []
    pitch_m = spacing_m(capture)
    least = 4 if capture.confocal else 2
    if pulse.wavelength_m < least * pitch_m * (1 - 1e-3):
        found.append(
            f"wavelength {pulse.wavelength_m * 100:.3g} cm is shorter than {least} times the spacing of "
            f"positions, {pitch_m * 100:.3g} cm: ghosts will appear; use "
            f"{least * pitch_m * 100:.3g} cm or more"
        )
    if response_fwhm_s and pulse.wavelength_m < shortest_wavelength_m(response_fwhm_s) * (1 - 1e-3):
        found.append(
            f"an instrument response of {response_fwhm_s * 1e12:.0f} ps blurs a wavelength of "
            f"{pulse.wavelength_m * 100:.3g} cm away; use "
            f"{shortest_wavelength_m(response_fwhm_s) * 100:.3g} cm or more"
        )
    extent_m = float(np.ptp(capture.laser_m, axis=0).max())
    if extent_m < 4 * pulse.wavelength_m:
        found.append(
            f"the wall is only {extent_m / pulse.wavelength_m:.1f} wavelengths wide: at a depth of its own "
            f"width nothing smaller than {0.61 * pulse.wavelength_m * 100:.3g} cm is resolved"
        )
    if isinstance(light, ContinuousWave):
        return found
    shortest_m, longest_m = path_limits_m(capture, grid)
    begin_m = float(capture.first_bin_s.max()) * C_M_PER_S
    end_m = (float(capture.first_bin_s.min()) + capture.bins * capture.bin_width_s) * C_M_PER_S
    if shortest_m < begin_m:
        found.append(
            f"the record begins at {begin_m:.2f} m of path, the volume at {shortest_m:.2f} m: its near part "
            f"is dark; begin at a depth of {begin_m / 2:.2f} m"
        )
    if longest_m > end_m:
        found.append(
            f"the record ends at {end_m:.2f} m of path, the volume at {longest_m:.2f} m: its far part and "
            "corners see only a part of the wall; take a longer record or a smaller volume"
        )
    return found
