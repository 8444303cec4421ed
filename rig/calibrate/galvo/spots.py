"""Where the laser spot is in a picture, to a small part of a pixel."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rig.calibrate import Floats, require
from rig.calibrate.fits import reweighted

#: A spot is looked for in squares of so many pixels a side, which makes it quick and sees faint ones,
BINNED = 4
#: and stands out of their noise by so many standard deviations: noise alone does in one of a million
#: pictures.
STANDS_OUT = 7.0
#: A second spot with at least this part of the first one's light is told; less is a faint reflection.
MAX_SECOND = 0.1
#: The spot is fitted in a window of so many pixels to either side.
WINDOW_PX = 9


@dataclass(frozen=True)
class Background:
    """What a camera sees while the laser is dark.

    Attributes
    ----------
    mean, variance
        (height, width) of one picture's counts, the variance as a smooth function of the mean.
    counts_per_count
        By how much the variance grows with each count of light.
    full
        Count at which a pixel is full.
    """

    mean: NDArray[np.float32]
    variance: NDArray[np.float32]
    counts_per_count: float
    full: int


@dataclass(frozen=True)
class Spot:
    """A spot's centre (column, row) [pixels], and the covariance of both."""

    centre: Floats
    covariance: Floats


def background(dark: NDArray[np.uint16], full: int) -> Background:
    """Average (n, height, width) dark pictures, and learn their noise: a straight line over the mean.

    Read noise does not depend on the light, and the variance of photons is in proportion to it.
    """
    mean = dark.mean(axis=0, dtype=np.float32)
    variance = dark.var(axis=0, ddof=1, dtype=np.float32)
    shares = np.quantile(mean[::4, ::4], [0.02, 0.25, 0.5, 0.75, 0.98])
    slope = 0.0
    if shares[-1] - shares[0] > 10:  # else all pixels are alike, and there is no line to draw
        centred = mean - mean.mean(dtype=np.float64)
        slope = max(float((centred * variance).sum() / (centred**2).sum()), 0.0)
    level = float(variance.mean(dtype=np.float64)) - slope * float(mean.mean(dtype=np.float64))
    smooth = np.maximum(level + slope * mean, 1 / 12)  # whole counts alone have this variance
    return Background(mean, (smooth * (1 + 1 / len(dark))).astype(np.float32), slope, full)


def find_spot(lit: NDArray[np.uint16], dark: Background, where: str) -> Spot:
    """Return the one spot of a (height, width) picture; ``where`` says for messages which one it is.

    Raises CalibrationError if there is no spot, or a second one, or it fills pixels, or is at the edge.
    """
    light = lit - dark.mean
    places = _bright_places(light, dark)
    require(
        places,
        f"{where}: no spot is seen. Does the laser emit, does the beam meet the wall, and does the camera "
        "see that part of it? Use a longer exposure, or measure a smaller area",
    )
    (share, row, column), (second, other_row, other_column) = [*places, (0.0, 0, 0)][:2]
    require(
        second <= MAX_SECOND * share,
        f"{where}: two spots are seen, near pixels ({column}, {row}) and ({other_column}, {other_row}), the "
        f"second with {second / share:.0%} of the light. Cover what reflects the beam, "
        "and keep other lights constant",
    )
    height, width = lit.shape
    require(
        WINDOW_PX <= row < height - WINDOW_PX and WINDOW_PX <= column < width - WINDOW_PX,
        f"{where}: the spot is at the image's edge, at pixel ({column}, {row}) of {width} x {height}. Turn "
        "the camera so that it sees the whole scanned wall, or measure a smaller area",
    )
    window = np.s_[row - WINDOW_PX : row + WINDOW_PX + 1, column - WINDOW_PX : column + WINDOW_PX + 1]
    full = int((lit[window] >= dark.full).sum())
    require(
        not full,
        f"{where}: the spot is saturated, {full} pixels are full at {dark.full} counts. "
        "Use a shorter exposure, close "
        "the iris, or attenuate the laser",
    )
    spot = _fit(light[window], dark.variance[window], dark.counts_per_count)
    return Spot(spot.centre + np.array([column - WINDOW_PX, row - WINDOW_PX], dtype=float), spot.covariance)


def _bright_places(light: NDArray[np.float32], dark: Background) -> list[tuple[float, int, int]]:
    """Return light and brightest pixel (row, column) of what stands out, the brightest first."""
    sums, variances = _binned(light), _binned(dark.variance)
    labels, _ = ndimage.label(sums > STANDS_OUT * np.sqrt(variances), structure=np.ones((3, 3)))
    found = []
    for rows, columns in ndimage.find_objects(labels):
        part = light[BINNED * rows.start : BINNED * rows.stop, BINNED * columns.start : BINNED * columns.stop]
        row, column = np.unravel_index(int(part.argmax()), part.shape)
        found.append(
            (float(part.sum()), int(row) + BINNED * rows.start, int(column) + BINNED * columns.start)
        )
    return sorted(found, reverse=True)


def _binned(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sum squares of pixels; what is left over at the right and lower rim is cut off."""
    rows, columns = image.shape[0] // BINNED, image.shape[1] // BINNED
    whole = image[: rows * BINNED, : columns * BINNED].reshape(rows, BINNED, columns, BINNED)
    return np.asarray(whole.sum(axis=(1, 3)))


def _fit(light: NDArray[np.float32], variance: NDArray[np.float32], per_count: float) -> Spot:
    """Fit an elliptical Gaussian on an even ground, weighted by the noise of ground and spot.

    Its numbers: light, centre, three of the inverse covariance, ground.
    """
    y, x = np.mgrid[: light.shape[0], : light.shape[1]].astype(float)
    peak = float(light.max())
    row, column = np.unravel_index(int(light.argmax()), light.shape)
    spread = np.sqrt(max(float(light.sum()) / (2 * np.pi * peak), 0.3))
    start = np.array([peak, column, row, spread**-2, 0.0, spread**-2, 0.0])

    def model(n: Floats) -> Floats:
        u, v = x - n[1], y - n[2]
        return (n[0] * np.exp(-(n[3] * u * u + 2 * n[4] * u * v + n[5] * v * v) / 2) + n[6]).ravel()

    def noise(due: Floats) -> Floats:
        return np.sqrt(variance.ravel() + per_count * np.maximum(due, 0))

    numbers, covariance, chi2 = reweighted(model, light.ravel().astype(float), noise, start)
    covariance = covariance * max(1.0, chi2 / (light.size - len(start)))
    return Spot(numbers[1:3], covariance[1:3, 1:3])
