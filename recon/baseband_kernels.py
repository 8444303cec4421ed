"""The compiled loops of `recon.baseband`; complex numbers are real and imaginary parts in turn."""

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(nogil=True, cache=True, fastmath=True, error_model="numpy")
def mix_photons(photons, first, table, edges, following, cells, before):  # type: ignore[no-untyped-def]
    """Add photons (row, bin, weight) to their cells, and to the copies at the edges that follow them."""
    rows, bins, weights = photons
    width = table.shape[1]
    for photon in range(len(rows)):
        row, n, weight = rows[photon], bins[photon], weights[photon]
        line = cells[row]
        for j in range(width):
            line[2 * first[n] + j] += weight * table[n, j]
        for e in range(following[n], len(edges)):
            beyond = 2 * (first[edges[e]] - first[n])
            if beyond >= width:
                break
            for j in range(beyond, width):
                before[e, row, j - beyond] += weight * table[n, j]


@njit(nogil=True, cache=True, fastmath=True, error_model="numpy")
def add_turned(
    sums: NDArray[np.complexfloating],
    begins_s: NDArray[np.float64],
    first_rad_per_s: float,
    step_rad_per_s: float,
    where: NDArray[np.intp],
    spectra: NDArray[np.complexfloating],
) -> None:
    """Add (F, block) sums, turned by exp(-i omega begin), to the columns `where` of (F, P) spectra."""
    many = len(where)
    turn, step = np.empty(many, np.complex128), np.empty(many, np.complex128)
    for p in range(many):
        angle = first_rad_per_s * begins_s[p]
        turn[p] = complex(np.cos(angle), -np.sin(angle))
        angle = step_rad_per_s * begins_s[p]
        step[p] = complex(np.cos(angle), -np.sin(angle))
    line = np.empty(many, spectra.dtype)
    for f in range(len(sums)):
        row, target = sums[f], spectra[f]
        for p in range(many):  # apart from places that are anywhere: so it is vectorised
            line[p] = row[p] * turn[p]
            turn[p] *= step[p]
        for p in range(many):
            target[where[p]] += line[p]
