"""Fourier sums of the histograms at the few frequencies that the pulse needs.

H^(p, omega) = sum_n H[p, n] exp(-i omega t_n), with t_n the rectified time of the centre of bin n. For some
tens of frequencies this is a real matrix product, counts times [cos, -sin], at the speed of sgemm; the time
of the first bin, which may differ between positions, is a phase on its result.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import DTypeLike, NDArray

from recon.capture import Capture
from recon.sampling import Slab
from recon.window import Fades


def spectra(
    capture: Capture,
    slabs: Sequence[Slab],
    fades: Fades,
    progress: Callable[[float], None] | None = None,
    dtype: DTypeLike = np.complex64,
) -> list[NDArray[np.complexfloating]]:
    """Take the spectra of all positions, for every slab, in one pass over the record.

    Parameters
    ----------
    capture
        Histograms, read in blocks; only the bins that some slab needs are asked for.
    slabs
        Bins and frequencies.
    fades
        Soft edges.
    progress
        Called with the fraction that is done.
    dtype
        complex64, or complex128 for reference.

    Returns
    -------
    list of ndarray
        (F, P) of `dtype` for each slab; (0, P) for one that the record does not reach.
    """
    real = np.empty(0, dtype).real.dtype
    results = [np.zeros((slab.reached * len(slab.band), capture.positions), dtype) for slab in slabs]
    wanted = [slab.bins for slab in slabs if slab.reached]
    if not wanted:
        return results
    bins = slice(min(part.start for part in wanted), max(part.stop for part in wanted))
    end = fades.end_weights(capture.bins, capture.bin_width_s)
    matrices = [_fourier_matrix(slab, capture.bin_width_s, end[slab.bins], dtype) for slab in slabs]
    for block, counts in capture.histograms.blocks(bins):
        faded = np.array(counts, dtype=real)
        first_bin_s = capture.first_bin_s if len(capture.first_bin_s) == 1 else capture.first_bin_s[block]
        start = fades.start_weights(first_bin_s, bins, capture.bin_width_s)
        faded[:, : start.shape[1]] *= start
        for slab, matrix, result in zip(slabs, matrices, results, strict=True):
            part = faded[:, slab.bins.start - bins.start : slab.bins.stop - bins.start]
            if slab.reached:
                result[:, block] = (part @ matrix).view(dtype).T
        if progress:
            progress(block.stop / capture.positions)
    for slab, result in zip(slabs, results, strict=True):
        if slab.reached:
            result *= np.exp(-1j * np.multiply.outer(slab.band.frequencies_rad_per_s, capture.first_bin_s))
    return results


def _fourier_matrix(
    slab: Slab, bin_width_s: float, weights: NDArray[np.float64], dtype: DTypeLike
) -> NDArray[np.floating]:
    """(bins, 2 F): real and imaginary part of exp(-i omega t) in turn, t counted from the record's start."""
    centres_s = (np.arange(slab.bins.start, slab.bins.stop) + 0.5) * bin_width_s
    factors = np.exp(-1j * np.multiply.outer(centres_s, slab.band.frequencies_rad_per_s))
    return (factors * weights[:, None]).astype(dtype).view(np.empty(0, dtype).real.dtype)
