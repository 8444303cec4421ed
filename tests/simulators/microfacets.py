"""A rough mirror made of facets that are drawn one by one: the slow reference for the gloss of GGX.

The surface is Smith's ("Geometrical shadowing of a random rough surface", IEEE Trans. Antennas Propag. 15
(1967)): a facet's slope and its height have nothing to do with each other, nor with those of its neighbours.
Slopes are Gaussian with a variance that differs from facet to facet, and whose inverse is exponentially
distributed. That is the distribution of Trowbridge and Reitz; neither it nor its masking function is written
down here. Heights are told as ranks, the share of facets that lie lower.
"""

from math import erfc, pi

import numpy as np

#: Cosines of the directions for which shadows are tabulated, and strata of the deviation of slopes.
COSINES, STRATA = np.linspace(0.01, 0.9999, 200), 400


def slopes(alpha, number, rng):
    """Draw (number, 2) slopes of facets."""
    deviation = alpha / np.sqrt(2 * rng.standard_exponential(number))
    return deviation[:, None] * rng.standard_normal((number, 2))


def shadow(alpha):
    """Areas of the facets that turn their backs to a direction, seen along it, for those of `COSINES`.

    They are the mean of max(0, slope along the direction / cotangent - 1). A ray in this direction that rises
    from rank u to u + du meets a facet with this times du / u, so it is free from rank u on with the
    probability u to the power of this. For Gaussian slopes of one deviation it is Smith's function;
    its mean over the deviations is taken in strata, closer where they are large.
    """
    stratum = (np.arange(STRATA) + 0.5) / STRATA
    deviation = alpha / np.sqrt(-2 * np.log1p(-(stratum**2)))
    cotangent = COSINES / np.sqrt(1 - COSINES**2)
    v = cotangent[:, None] / deviation
    of_one = np.exp(-(v**2) / 2) / (np.sqrt(2 * pi) * v) - np.vectorize(erfc)(v / np.sqrt(2)) / 2
    return of_one @ (2 * stratum) / STRATA


def reflect(i, alpha, rng):
    """Let each ray meet a facet, if it gets there, and leave, if nothing is in its way.

    Parameters
    ----------
    i
        (N, 3) unit directions where the rays come from, above the plane z = 0.

    Returns
    -------
    o
        (N, 3) unit directions where they go.
    light
        (N,) what each brings along: their mean is the share that leaves after one reflection.
    """
    slope, shadows = slopes(alpha, len(i), rng), shadow(alpha)
    facet = np.column_stack([-slope, np.ones(len(i))])
    across = (i * facet).sum(axis=1)  # of a facet over 1 m^2 of ground, as seen from where the ray comes from
    facet /= np.linalg.norm(facet, axis=1)[:, None]
    o = 2 * (i * facet).sum(axis=1)[:, None] * facet - i
    rank = rng.random(len(i))
    light = np.maximum(across, 0.0) / i[:, 2]
    for direction in (i, o):
        free = rank ** np.interp(direction[:, 2], COSINES, shadows)
        light *= (direction[:, 2] > 0) & (rng.random(len(i)) < free)
    return o, light
