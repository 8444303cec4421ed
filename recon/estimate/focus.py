"""How sharp a record's image is, tried with the hidden light at many depths.

A time that is wrong bends the waves wrongly: a point at depth D, imaged at D + dD, is out of focus by a path
of a^2/8 (1/D - 1/(D + dD)) at the edge of a wall of side a. So trials are even in 1/D, and what each unknown
makes of it (a later record, wider bins, a smaller wall) is one curve, sharpness over 1/D.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from recon import defaults
from recon.capture import ArrayHistograms, Capture
from recon.estimate.value import EstimateError
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.wave import VirtualPulse

#: Trials: inverse depth of the first hidden light, in parts of the wall's side; 2.5 to 0.25 sides away.
TRIALS = np.linspace(0.4, 4.0, 26)
#: Wavelength in spacings of positions, of confocal records and others; the shortest, in parts of the wall.
SPACINGS_CONFOCAL, SPACINGS_ONE_SPOT, SHORTEST = 5.0, 3.5, 1 / 16
#: Voxels and planes a wavelength; planes at most; width of the volume in parts of the wall.
VOXELS, MOST_PLANES, WIDE = 3, 48, 1.2
#: How far the sharpness, a logarithm, may fall within what the data cannot tell apart. Measured, see
#: docs/estimates.md.
LEVEL = 0.06
#: How much sharper than with its positions shuffled an image must be.
ABOVE_SHUFFLED = 0.1


@dataclass(frozen=True)
class Trial:
    """A record as it would be with its first hidden light at some depth, and where its last is then."""

    capture: Capture
    last_m: float


#: From the depth of the first hidden light [m] to a trial.
Moved = Callable[[float], Trial]


@dataclass(frozen=True)
class Focus:
    """Where an image is sharp.

    Attributes
    ----------
    depth_m
        Depth of the first hidden light at which the image is sharpest.
    nearest_m, farthest_m
        All depths that are about as sharp lie between these.
    """

    depth_m: float
    nearest_m: float
    farthest_m: float


def wavelength_m(capture: Capture) -> float:
    """Return the wavelength of the trials."""
    spacings = SPACINGS_CONFOCAL if capture.confocal else SPACINGS_ONE_SPOT
    return max(spacings * defaults.spacing_m(capture), SHORTEST * side_m(capture))


def side_m(capture: Capture) -> float:
    """Return the longer side of the scanned wall."""
    return float(np.ptp(capture.laser_m, axis=0).max())


def sharpest(capture: Capture, moved: Moved) -> Focus:
    """Find the depth of the first hidden light at which the image is sharpest.

    Parameters
    ----------
    capture
        The record, thinned.
    moved
        Makes the trials.

    Raises
    ------
    EstimateError
        If the data cannot tell.
    """
    side, wavelength = side_m(capture), wavelength_m(capture)
    inverse = TRIALS / side
    pulse = VirtualPulse(wavelength, 2)
    trials = ((moved(1 / k), 1 / k) for k in inverse)
    tried = [_sharpness(trial, _voxels(trial, depth_m, wavelength), pulse) for trial, depth_m in trials]
    fine = np.linspace(inverse[0], inverse[-1], 2000)
    curve = CubicSpline(inverse, tried)(fine)
    best = int(curve.argmax())
    depth_m = 1 / float(fine[best])
    if best in (0, len(fine) - 1):
        end = "nearest" if best else "farthest"
        raise cannot(f"it is sharpest with the first hidden light at the {end} depth tried, {depth_m:.2g} m")
    trial = moved(depth_m)
    shuffled = replace(trial, capture=_shuffled(trial.capture))
    if curve[best] < _sharpness(shuffled, _voxels(trial, depth_m, wavelength), pulse) + ABOVE_SHUFFLED:
        raise cannot("it is as sharp with shuffled positions: nothing in the record comes to a focus")
    alike = np.flatnonzero(curve >= curve[best] - LEVEL)
    return Focus(depth_m, 1 / float(fine[alike[-1]]), 1 / float(fine[alike[0]]))


def _voxels(trial: Trial, depth_m: float, wavelength: float) -> VoxelGrid:
    """Return voxels before the wall's middle, from just before the first light to the last."""
    spots_m = trial.capture.laser_m
    wide, middle = WIDE * side_m(trial.capture), (spots_m.min(axis=0) + spots_m.max(axis=0)) / 2
    step = wavelength / VOXELS
    near = max(0.93 * depth_m - wavelength / 2, wavelength / 4)
    far = min(trial.last_m + wavelength / 2, near + MOST_PLANES * step)
    return VoxelGrid.from_spec(wide, wide, step, (near, far, step), (float(middle[0]), float(middle[1])))


def _sharpness(trial: Trial, grid: VoxelGrid, pulse: VirtualPulse) -> float:
    """Return ln(sum F^2 / (sum F)^2) of the front view's amplitude F: the fewer bright pixels, the greater.

    The same of the intensity minds more the few bright spots where a plane or a round body acts as a mirror,
    which are sharp at other depths: of 40 simulated scans it put 5 more than 1.5 ns off, this one none.
    """
    field = image(trial.capture, pulse, grid).field
    assert field is not None
    amplitude = (np.abs(field) * grid.z_m[:, None, None]).max(axis=0).astype(float)
    return float(np.log((amplitude**2).sum() / amplitude.sum() ** 2))


def _shuffled(capture: Capture) -> Capture:
    """Return the record with its rows at each other's positions."""
    order = np.random.default_rng(0).permutation(capture.positions)
    first_s = capture.first_bin_s
    return replace(
        capture,
        histograms=ArrayHistograms(_counts(capture)[order]),
        first_bin_s=first_s if len(first_s) == 1 else first_s[order],
    )


def _counts(capture: Capture) -> NDArray:
    return np.concatenate([counts for _, counts in capture.histograms.blocks()])


def cannot(found: str) -> EstimateError:
    """Return the refusal of an estimate, with what was found."""
    return EstimateError(
        "estimate",
        "the value that makes the image sharpest",
        found,
        "The data do not determine it: give the value, or record for longer or over a larger wall.",
    )
