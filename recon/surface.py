"""Which pixels show a surface, where it is, and how sure that is.

One threshold on the whole picture fails in three ways: a glint, a few pixels a hundred times brighter than
all else, decides for everything; noise of far planes becomes surface; and of two like things the darker is
lost. So what is seen has to stand out from the noise at its place (`recon.noise`), and from what the
brightest scatters; and then each connected surface has a threshold of its own, a part of its brightness.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import log

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from recon.depth import compensate_falloff, front_view, peak_depth
from recon.noise import Noise
from recon.result import Image

#: What the brightest thing scatters into other pixels, as a part of it.
SCATTERED = 0.01
#: Without counted photons, a surface has this many times what the quietest quarter of the pixels stays below.
QUIET_FACTOR, QUIET_PERCENT = 2.0, 25.0
#: Pixels of a surface have at least this part of what its brightest twentieth has.
PART, BRIGHT_PERCENT = 0.12, 95.0
#: Confidence that a pixel of a surface has: a pixel in a thousand of noise is taken for one.
SURE = 0.999
#: Chance with which an image of nothing is not called empty.
CHANCE = 0.01


@dataclass(frozen=True)
class Surface:
    """The surface that is seen.

    Attributes
    ----------
    depth_m
        (y, x) float32 depth, NaN where none is seen.
    confidence
        (y, x) float32, 0 to 1: the probability that noise alone stays below what is brightest at the pixel,
        at all depths together.
    contrast
        (y, x) float32: intensity over that of noise there.
    empty
        Whether the brightest voxel of all is no more than photon noise gives in `CHANCE` of images; without
        counted photons, whether the image is dark.
    """

    depth_m: NDArray[np.float32]
    confidence: NDArray[np.float32]
    contrast: NDArray[np.float32]
    empty: bool

    def contrast_seen(self) -> float:
        """Return the median contrast of the pixels that show a surface; 0 where none does."""
        seen = np.isfinite(self.depth_m)
        return float(np.median(self.contrast[seen])) if seen.any() else 0.0


def find(image: Image, noise: Noise) -> Surface:
    """Find the surface in an image.

    Noise is distributed exponentially around its mean, so that a ratio rho to the mean has the chance
    exp(-rho) at a voxel, and 1 - (1 - exp(-rho))^M at M depths that are a pulse's width apart.

    Parameters
    ----------
    image
        Of one moment.
    noise
        Its noise.
    """
    intensity, z_m = image.intensity, image.grid.z_m
    compensated = compensate_falloff(intensity, z_m, image.falloff_power)
    front, brightest = front_view(compensated), compensated.argmax(axis=0)
    contrast, greatest = np.zeros(front.shape, np.float32), 0.0
    least = max(float(intensity.max()) * 1e-20, float(np.finfo(np.float32).tiny))  # of noise-free images
    for number, plane in enumerate(intensity):
        rho = plane / np.maximum(noise.plane(number, front.shape), least)
        contrast = np.where(brightest == number, rho, contrast)
        greatest = max(greatest, float(rho.max()))
    width_m = _pulse_depth_m(image)
    depths = max(1.0, float(z_m[-1] - z_m[0]) / width_m)
    confidence = np.exp(depths * np.log1p(-np.exp(-np.maximum(contrast, 1e-9, dtype=np.float64))))
    depth_m = peak_depth(compensated, z_m, image.late_s)
    bright = front > SCATTERED * float(front.max())
    if noise.photons:
        bright &= confidence > SURE
    else:
        bright &= front > QUIET_FACTOR * float(np.percentile(front, QUIET_PERCENT))
    empty = not greatest > (log(front.size * depths / CHANCE) if noise.photons else 0.0)
    seen = np.zeros_like(bright) if empty else _parts(front, depth_m, bright, width_m)
    return Surface(
        np.where(seen, depth_m, np.nan).astype(np.float32), confidence.astype(np.float32), contrast, empty
    )


def _pulse_depth_m(image: Image) -> float:
    """Return how far apart in depth two surfaces are told apart: the pulse's width, or two planes."""
    z_m = image.grid.z_m
    planes_m = 2 * float(z_m[1] - z_m[0]) if len(z_m) > 1 else 1.0
    if image.pulse is None:
        return planes_m
    # Full width at half maximum of the intensity, there and back.
    return max(planes_m, 2.36 * image.pulse.sigma_s * C_M_PER_S / 2 / 2**0.5)


def _parts(
    front: NDArray[np.float32], depth_m: NDArray[np.float32], bright: NDArray[np.bool_], reach_m: float
) -> NDArray[np.bool_]:
    """Keep of each connected surface what has a part of its own brightness, (y, x)."""
    labels, count = _connected(bright, depth_m, reach_m)
    order = np.argsort(labels, axis=None, kind="stable")
    edges = np.searchsorted(labels.reshape(-1)[order], np.arange(count + 1))
    flat, seen = front.reshape(-1), np.zeros(front.size, bool)
    for first, stop in pairwise(edges):
        pixels = order[first:stop]
        seen[pixels] = flat[pixels] >= PART * np.percentile(flat[pixels], BRIGHT_PERCENT)
    return seen.reshape(front.shape)


def _connected(
    bright: NDArray[np.bool_], depth_m: NDArray[np.float32], reach_m: float
) -> tuple[NDArray[np.intp], int]:
    """Give connected surfaces numbers, (y, x) with -1 where there is none, and count them.

    Neighbours belong to one where both are bright and their depths differ by no more than `reach_m`.
    """
    from scipy.sparse import coo_array  # a tenth of a second, that other verbs need not wait for
    from scipy.sparse.csgraph import connected_components

    number = np.arange(bright.size).reshape(bright.shape)
    ahead, behind = slice(1, None), slice(-1)
    everything = slice(None)
    links = []
    for one, other in (
        ((everything, ahead), (everything, behind)),
        ((ahead, everything), (behind, everything)),
    ):
        joined = bright[one] & bright[other] & (np.abs(depth_m[one] - depth_m[other]) <= reach_m)
        links.append(np.stack([number[one][joined], number[other][joined]]))
    first, second = np.concatenate(links, axis=1)
    graph = coo_array((np.ones(len(first), bool), (first, second)), shape=(bright.size, bright.size))
    _, labels = connected_components(graph, directed=False)
    names, found = np.unique(labels[bright.reshape(-1)], return_inverse=True)
    labels = np.full(bright.size, -1, np.intp)
    labels[bright.reshape(-1)] = found
    return labels.reshape(bright.shape), len(names)
