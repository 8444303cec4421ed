"""Fourier sums photon by photon: a compiled kernel in a file of its own, since the rest needs numpy alone."""

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(nogil=True, cache=True, fastmath=True)
def sum_photons(
    row: NDArray[np.intp],
    place: NDArray[np.intp],
    weight: NDArray[np.floating],
    piece: NDArray[np.intp],
    matrix: NDArray[np.floating],
    summed: NDArray[np.floating],
) -> None:
    """Add to (pieces, rows, 2 F) sums the factors of each photon's bin; what is outside is left out."""
    for photon in range(len(row)):
        at = place[photon]
        if 0 <= at < len(matrix):
            total = summed[piece[at], row[photon]]
            factors = matrix[at]
            for number in range(len(factors)):
                total[number] += weight[photon] * factors[number]
