"""Imaging from a hidden surface: looking around a second corner.

A hidden surface that reflects diffusely can be an aperture as the relay wall is. The wall's field is focused
on points m of the surface, and goes on from there to the voxels:

    F(m, omega) = g(omega) sum_p H^(p, omega) exp(i omega r_pm/c) / r_pm
    U(v) = sum_omega exp(i omega t(v)) sum_m F'(m, omega) exp(i omega r_mv/c) / r_mv ,

with t(v) the time at which the one detector spot, the virtual lamp, lights the voxel: r_c(v)/c where it sees
the voxel (light of four bounces: wall, voxel, surface, wall), and min over m of (r_cm + r_mv)/c by way
of the surface, where it does not (five bounces: wall, surface, voxel, surface, wall). The shortest way is
Fermat's, on which the phases of neighbouring points agree: a surface that is smooth on the scale of the
wavelength reflects the phasor field as a mirror does.

F' is F without the lamp's own flash on the surface, its light of three bounces, which is a thousand times
stronger than what comes by way of something else. The flash is at point m at the time r_cm/c, and all else
comes later: F is taken to time, faded in after the flash, and taken back. What the wall's limited aperture
leaves of the flash elsewhere remains; where the record itself has times without it, a window is better.

After Royo et al., "Virtual Mirrors: Non-Line-of-Sight Imaging Beyond the Third Bounce", ACM Trans. Graph. 42
(2023), in the sign convention of `recon.imaging.image`; fading out the flash is ours.
"""

from collections.abc import Iterator
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S, Capture
from recon.errors import GeometryError, ParameterError, ReachError
from recon.sampling import DepthBlock
from recon.spectrum import spectra
from recon.wave import Band, VirtualPulse
from recon.window import Window

#: Pairs of points whose waves are in memory at once: 32 MB of them, and as much for their steps.
PAIRS = 4 * 2**20
#: When after the flash the field at the surface is faded in, in standard deviations of the pulse: of the
#: flash's amplitude exp(-2) is left at the begin, and 3e-4 at the end.
FADE_SIGMAS = (2.0, 4.0)


def image_from(
    surface_m: NDArray[np.float64],
    capture: Capture,
    pulse: VirtualPulse,
    voxels_m: NDArray[np.float64],
    *,
    lit_by_surface: bool,
    window: Window | None = None,
) -> NDArray[np.complex64]:
    """Focus on voxels from a hidden surface, whose place is known.

    Voxels within some two wavelengths of the surface fade with the lamp's flash on it. Where the lamp's light
    goes straight on to the surface, time does not tell depths apart, and only the surface's width does.
    Work is frequencies x points x (positions + voxels): a few seconds for a thousand points and voxels.

    Parameters
    ----------
    surface_m
        (N, 3) points of the surface, evenly spread, at most half a wavelength apart [m].
    capture
        A scan with one detector spot.
    pulse
        The virtual illumination.
    voxels_m
        (V, 3) where to look [m]; they need not be in front of the wall's middle, nor on a grid.
    lit_by_surface
        Whether light comes to the voxels by way of the surface (five bounces), or directly (four).
    window
        Soft edges of the record; by default only its end is softened. A start after the last light of three
        bounces keeps that out.

    Returns
    -------
    ndarray
        (V,) complex64 field U.

    Raises
    ------
    GeometryError
        If the capture has more than one detector spot.
    ParameterError
        If there are no surface points or no voxels, or the arrays are not (N, 3) and (V, 3).
    ReachError
        If no path to the voxels falls inside the record.
    """
    if capture.round_trip:
        raise GeometryError(
            "secondary aperture",
            "one detector spot",
            f"the capture has {len(capture.detector_m)}",
            "Use the positions of one detector spot.",
        )
    for name, points_m in (("surface_m", surface_m), ("voxels_m", voxels_m)):
        if points_m.ndim != 2 or points_m.shape[1] != 3 or not len(points_m):
            raise ParameterError(
                "secondary aperture", f"{name} of shape {points_m.shape}", "it is not (N, 3)", "Give points."
            )
    lamp_m = lamp_paths_m(capture.detector_m[0], surface_m, voxels_m, lit_by_surface)
    part = _seen(capture, pulse, surface_m, voxels_m, lamp_m)
    wall = spectra(capture, [part], window or Window())[0]
    field = propagated(wall, capture.laser_m, surface_m, part.band) * part.band.weights[:, None]
    flash_s = np.linalg.norm(surface_m - capture.detector_m[0], axis=1) / C_M_PER_S
    at_voxels = propagated(_after(flash_s, field, part.band, pulse), surface_m, voxels_m, part.band)
    turn = np.multiply.outer(part.band.frequencies_rad_per_s / C_M_PER_S, lamp_m)
    return (np.exp(1j * turn) * at_voxels).sum(axis=0).astype(np.complex64)


def _after(
    flash_s: NDArray[np.float64], field: NDArray[np.complexfloating], band: Band, pulse: VirtualPulse
) -> NDArray[np.complexfloating]:
    """Fade a field (F, N) in after a flash (N,), up to two half-lengths of the pulse before the next one."""
    period_s = 2 * np.pi / band.step_rad_per_s
    samples = 2 * len(band)
    times_s = np.arange(samples) * period_s / samples
    turns = np.exp(1j * np.multiply.outer(times_s, band.step_rad_per_s * np.arange(len(band))))
    early_s = 2 * pulse.half_length_s
    late_s = (times_s[:, None] - flash_s + early_s) % period_s - early_s
    begin, end = FADE_SIGMAS
    risen = np.clip((late_s / pulse.sigma_s - begin) / (end - begin), 0, 1)
    return turns.conj().T @ (turns @ field * (0.5 - 0.5 * np.cos(np.pi * risen))) / samples


def lamp_paths_m(
    lamp_spot_m: NDArray[np.float64],
    surface_m: NDArray[np.float64],
    voxels_m: NDArray[np.float64],
    lit_by_surface: bool,
) -> NDArray[np.float64]:
    """Return paths (V,) from the lamp (3,) to voxels (V, 3) [m]: straight, or the shortest by the surface.

    Between points at a distance d of each other the shortest is found to d^2 / (4 r), r the shorter leg.
    """
    if not lit_by_surface:
        return np.linalg.norm(voxels_m - lamp_spot_m, axis=1)
    to_surface_m = np.linalg.norm(surface_m - lamp_spot_m, axis=1)
    paths_m = np.empty(len(voxels_m))
    for part, distance_m in _distances(surface_m, voxels_m):
        paths_m[part] = (distance_m + to_surface_m).min(axis=1)
    return paths_m


def propagated(
    emitted: NDArray[np.complexfloating],
    sources_m: NDArray[np.float64],
    targets_m: NDArray[np.float64],
    band: Band,
) -> NDArray[np.complex64]:
    """Focus spectra E (F, S) of points (S, 3) on others (T, 3): sum_s E(s, omega) exp(i omega r/c) / r.

    Returns
    -------
    ndarray
        (F, T) complex64.
    """
    field = np.empty((len(band), len(targets_m)), np.complex64)
    first, step = band.first_rad_per_s / C_M_PER_S, band.step_rad_per_s / C_M_PER_S
    for part, distance_m in _distances(sources_m, targets_m):
        wave = (np.exp(1j * first * distance_m) / distance_m).astype(np.complex64)
        turn = np.exp(1j * step * distance_m).astype(np.complex64)
        for f, of_sources in enumerate(emitted):
            field[f, part] = wave @ of_sources.astype(np.complex64)
            wave *= turn
    return field


def _distances(
    sources_m: NDArray[np.float64], targets_m: NDArray[np.float64]
) -> Iterator[tuple[slice, NDArray[np.float64]]]:
    """Yield runs of targets, and their distances (run, S) from all sources [m]."""
    run = max(1, PAIRS // len(sources_m))
    for start in range(0, len(targets_m), run):
        part = slice(start, min(start + run, len(targets_m)))
        yield part, np.linalg.norm(targets_m[part, None] - sources_m, axis=2)


def _seen(
    capture: Capture,
    pulse: VirtualPulse,
    surface_m: NDArray[np.float64],
    voxels_m: NDArray[np.float64],
    lamp_m: NDArray[np.float64],
) -> DepthBlock:
    """Return the bins in which the voxels are seen, and the frequencies that image them without aliasing."""
    to_wall_m = _limits_m(surface_m, capture.laser_m)
    to_voxels_m = _limits_m(surface_m, voxels_m)
    earliest_s = (lamp_m.min() + to_voxels_m[0] + to_wall_m[0]) / C_M_PER_S
    latest_s = (lamp_m.max() + to_voxels_m[1] + to_wall_m[1]) / C_M_PER_S
    margin_s, width_s = pulse.half_length_s, capture.bin_width_s
    begin_s, end_s = float(capture.first_bin_s.min()), float(capture.first_bin_s.max())
    first = floor(np.clip((earliest_s - margin_s - end_s) / width_s, 0, capture.bins))
    stop = ceil(np.clip((latest_s + margin_s - begin_s) / width_s, 0, capture.bins))
    if stop <= first:
        raise ReachError(
            "secondary aperture",
            f"light that takes {earliest_s * 1e9:.2f} to {latest_s * 1e9:.2f} ns",
            f"the record holds {begin_s * 1e9:.2f} to {end_s * 1e9 + capture.bins * width_s * 1e9:.2f} ns",
            "Choose other voxels, or check the record's time origin.",
        )
    longest_lag_s = max(end_s + stop * width_s - earliest_s, latest_s - begin_s - first * width_s)
    # At the surface, as long as the record and what the ways from the wall differ by.
    lasts_s = end_s - begin_s + (stop - first) * width_s + (to_wall_m[1] - to_wall_m[0]) / C_M_PER_S
    return DepthBlock(
        slice(0, 1), slice(first, stop), pulse.band(max(longest_lag_s + margin_s, lasts_s + 3 * margin_s))
    )


def _limits_m(ones_m: NDArray[np.float64], others_m: NDArray[np.float64]) -> tuple[float, float]:
    """Return the least and the greatest distance between any two points of two sets [m]."""
    limits = [(d.min(), d.max()) for _, d in _distances(ones_m, others_m)]
    return float(min(low for low, _ in limits)), float(max(high for _, high in limits))
