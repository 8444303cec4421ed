"""Fourier sums of the histograms at the few frequencies that the pulse needs.

H^(p, omega) = sum_n H[p, n] exp(-i omega t_n), with t_n the rectified time of the centre of bin n. For some
tens of frequencies this is a real matrix product, counts times [cos, -sin], at the speed of sgemm; the time
of the first bin, which may differ between positions, is a phase on its result.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import DTypeLike, NDArray

from recon.capture import Capture
from recon.sampling import DepthBlock
from recon.window import Window, windowed_blocks


def spectra(
    capture: Capture,
    depth_blocks: Sequence[DepthBlock],
    window: Window,
    progress: Callable[[float], None] | None = None,
    dtype: DTypeLike = np.complex64,
) -> list[NDArray[np.complexfloating]]:
    """Take the spectra of all positions, for every depth block, in one pass over the record.

    Parameters
    ----------
    capture
        Histograms, read in blocks; only the bins that some depth block needs are asked for.
    depth_blocks
        Bins and frequencies.
    window
        Soft edges.
    progress
        Called with the fraction that is done.
    dtype
        complex64, or complex128 for reference.

    Returns
    -------
    list of ndarray
        (F, P) of `dtype` for each depth block; (0, P) for one that the record does not reach.
    """
    real = np.empty(0, dtype).real.dtype
    results = [
        np.zeros((depth_block.reached * len(depth_block.band), capture.positions), dtype)
        for depth_block in depth_blocks
    ]
    wanted = [depth_block.bins for depth_block in depth_blocks if depth_block.reached]
    if not wanted:
        return results
    bins = slice(min(part.start for part in wanted), max(part.stop for part in wanted))
    matrices = [_fourier_matrix(depth_block, capture.bin_width_s, dtype) for depth_block in depth_blocks]
    for positions, counts in windowed_blocks(capture, window, bins, real):
        for depth_block, matrix, result in zip(depth_blocks, matrices, results, strict=True):
            part = counts[:, depth_block.bins.start - bins.start : depth_block.bins.stop - bins.start]
            if depth_block.reached:
                result[:, positions] = (part @ matrix).view(dtype).T
        if progress:
            progress(positions.stop / capture.positions)
    for depth_block, result in zip(depth_blocks, results, strict=True):
        if depth_block.reached:
            result *= np.exp(
                -1j * np.multiply.outer(depth_block.band.frequencies_rad_per_s, capture.first_bin_s)
            )
    return results


def _fourier_matrix(depth_block: DepthBlock, bin_width_s: float, dtype: DTypeLike) -> NDArray[np.floating]:
    """(bins, 2 F): real and imaginary part of exp(-i omega t) in turn, t counted from the record's start."""
    centres_s = (np.arange(depth_block.bins.start, depth_block.bins.stop) + 0.5) * bin_width_s
    factors = np.exp(-1j * np.multiply.outer(centres_s, depth_block.band.frequencies_rad_per_s))
    return factors.astype(dtype).view(np.empty(0, dtype).real.dtype)
