"""Soft edges for a record, so that its ends and the wall's own peak do not image as bright shells."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import DTypeLike, NDArray

from recon.capture import Capture, Positions
from recon.errors import ParameterError


@dataclass(frozen=True)
class Window:
    """Raised-cosine edges of the record.

    The start is in **rectified** time (t = 0 with the pulse on the wall), position by position: what is
    hidden there, the wall's own peak and light from nearer than the scene, is tied to the wall and not to
    the record. The end is the **record's** own last bin.

    Attributes
    ----------
    start_s
        Rectified time before which counts are dropped; None keeps all.
    rise_s
        Duration of the rise that begins at `start_s`.
    fall_s
        Duration of the fall that ends with the record.

    Raises
    ------
    ParameterError
        If a duration is negative.

    Examples
    --------
    Light that comes within 4 ns after the pulse on the wall is left out; it fades in until 4.5 ns:

    >>> import numpy as np, recon
    >>> window = recon.Window(start_s=4e-9)
    >>> window.start_weights_at(np.array([3.9e-9, 4.25e-9, 4.6e-9])).round(3).tolist()
    [0.0, 0.5, 1.0]
    """

    start_s: float | None = None
    rise_s: float = 0.5e-9
    fall_s: float = 0.5e-9

    def __post_init__(self) -> None:
        for name in ("rise_s", "fall_s"):
            if getattr(self, name) < 0:
                raise ParameterError(
                    "window", f"{name} = {getattr(self, name)}", "it is negative", "Use 0.5 ns."
                )

    def end_weights(self, bins: int, bin_width_s: float) -> NDArray[np.float64]:
        """(bins,) weights that fall to zero at the right edge of the last bin."""
        before_end_s = (bins - 0.5 - np.arange(bins, dtype=np.float64)) * bin_width_s
        return _raised_cosine(before_end_s, self.fall_s)

    def start_weights(
        self, first_bin_s: NDArray[np.float64], bins: slice, bin_width_s: float
    ) -> NDArray[np.float64]:
        """Return the weights of the leading bins, up to where all are one.

        Parameters
        ----------
        first_bin_s
            (positions,) or (1,) left edge of bin 0 in rectified time.
        bins
            Bins asked for, with both ends given.
        bin_width_s
            Width of a bin.

        Returns
        -------
        ndarray
            (positions or 1, leading bins) float64, each position with its own start; without any bins where
            nothing fades.
        """
        if self.start_s is None:
            return np.ones((len(first_bin_s), 0))
        risen_s = self.start_s + self.rise_s - float(first_bin_s.min())
        stop = min(max(bins.start, ceil(risen_s / bin_width_s)), bins.stop)
        centres_s = (np.arange(bins.start, stop) + 0.5) * bin_width_s
        return _raised_cosine(first_bin_s[:, None] - self.start_s + centres_s, self.rise_s)

    def start_weights_at(self, rectified_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the weights at rectified times, of the start alone."""
        if self.start_s is None:
            return np.ones_like(rectified_s)
        return _raised_cosine(rectified_s - self.start_s, self.rise_s)


class Edges:
    """The soft edges of a part of the record.

    Parameters
    ----------
    capture
        Geometry and time axis; its histograms are not read.
    window
        Soft edges.
    bins
        Bins wanted, with both ends given.

    Attributes
    ----------
    end
        (bins,) weights with which the record ends.
    """

    def __init__(self, capture: Capture, window: Window, bins: slice) -> None:
        self._capture, self._window, self._bins = capture, window, bins
        self.end = window.end_weights(capture.bins, capture.bin_width_s)[bins]

    def start(self, positions: Positions) -> NDArray[np.float64]:
        """Return the weights of the leading bins of some positions, up to where all are one.

        They are (block or 1, leading bins).
        """
        begins_s = self._capture.begins_s(positions)
        return self._window.start_weights(begins_s, self._bins, self._capture.bin_width_s)

    def start_at(self, positions: NDArray[np.intp], bins: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return the start's weights of photons, each by its position and its bin in the record."""
        begins_s = np.broadcast_to(self._capture.begins_s(positions), positions.shape)
        return self._window.start_weights_at(begins_s + (bins + 0.5) * self._capture.bin_width_s)


def windowed_blocks(
    capture: Capture, window: Window, bins: slice, dtype: DTypeLike = np.float32
) -> Iterator[tuple[slice, NDArray[np.floating]]]:
    """Read a part of the record block by block, its edges softened.

    Parameters
    ----------
    capture
        Histograms.
    window, bins
        As of `Edges`.
    dtype
        Type of the counts that are yielded.

    Yields
    ------
    positions
        Which.
    counts
        (block, bins) of `dtype`, the reader's to change.
    """
    edges = Edges(capture, window, bins)
    end = edges.end.astype(dtype)
    falls = np.flatnonzero(end != 1)
    falls_from = int(falls[0]) if len(falls) else len(end)
    for block, counts in capture.histograms.blocks(bins):
        soft = np.array(counts, dtype=dtype)
        start = edges.start(block)
        soft[:, : start.shape[1]] *= start
        soft[:, falls_from:] *= end[falls_from:]
        yield block, soft


def _raised_cosine(distance_s: NDArray[np.float64], length_s: float) -> NDArray[np.float64]:
    """Zero up to the edge, one from `length_s` beyond it, half a cosine between."""
    if length_s == 0:
        return (distance_s >= 0).astype(np.float64)
    return 0.5 - 0.5 * np.cos(np.pi * np.clip(distance_s / length_s, 0, 1))
