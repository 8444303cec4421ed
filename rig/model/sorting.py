"""Photons of a stream, put into the windows of time to which they belong: a scan's positions, say."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

_NO_CHANNEL = -1


class SortedPhotons(NamedTuple):
    """Photons by window and channel.

    Attributes
    ----------
    photon_bins
        (kept,) bin of each photon: window after window, in each channel after channel, in each in the order
        of the stream. Memory of its own, of the type of ``dtime``.
    counts
        (windows, channels) int64, how many photons each has.
    taken
        How many photons of the stream come before the last edge. The others, ``tag[taken:]``, belong to
        windows that are still to come.
    """

    photon_bins: NDArray[np.unsignedinteger]
    counts: NDArray[np.int64]
    taken: int


def sort_photons(
    tag: NDArray[np.int64],
    dtime: NDArray[np.unsignedinteger],
    channel: NDArray[np.int8],
    edges: NDArray[np.int64],
    inputs: Sequence[int],
    bins: int,
) -> SortedPhotons:
    """Put each photon into its window and channel.

    Window k takes photons from ``edges[k]`` until before ``edges[k + 1]``. Left out are photons before the
    first edge, of other inputs, and beyond the bins. A window that a piece of a stream cuts in two is asked
    for with both pieces: each gives the part that it has. The work is done without Python's lock.

    Parameters
    ----------
    tag
        (photons,) times in the order of the stream. A photon whose time falls back, as damage alone can make
        it, is in the window of the photon before.
    dtime
        (photons,) bin of each; unsigned.
    channel
        (photons,) input of each; a negative one, as of a sync pulse, is none.
    edges
        (windows + 1,) times that do not fall, of the kind of ``tag``.
    inputs
        (channels,) input of each channel, 0 to 127.
    bins
        Number of bins of a histogram.

    Raises
    ------
    ValueError
        If the arrays of photons differ in length, edges fall, or an input has no or two channels.
    """
    if not len(tag) == len(dtime) == len(channel):
        raise ValueError(
            f"photons have {len(tag)} tags, {len(dtime)} bins and {len(channel)} inputs: not one of each"
        )
    if len(edges) == 0 or (np.diff(edges) < 0).any():
        raise ValueError("edges of windows must be one or more, and must not decrease")
    table = _table(inputs)
    counts = np.zeros((len(edges) - 1, len(inputs)), np.int64)
    photon_bins = np.empty(len(tag), dtime.dtype)
    kept, taken = _sort(tag, dtime, channel.view(np.uint8), edges, table, bins, photon_bins, counts)
    return SortedPhotons(photon_bins[:kept], counts, taken)


def _table(inputs: Sequence[int]) -> NDArray[np.int64]:
    """Return the channel of each input as an unsigned byte, so that no input lies beyond the table."""
    if len(set(inputs)) != len(inputs) or not all(0 <= one < 128 for one in inputs):
        raise ValueError(f"inputs {list(inputs)} of channels must differ, and be 0 to 127")
    table = np.full(256, _NO_CHANNEL)
    table[list(inputs)] = np.arange(len(inputs))
    return table


@njit(cache=True, nogil=True)
def _sort(tag, dtime, channel, edges, channel_of, bins, photon_bins, counts):  # type: ignore[no-untyped-def]
    """Fill the bins and the counts; return how many bins there are, and how many photons were looked at.

    A window's photons are gone through twice: to count them, and to write each where the counts say.
    """
    place = np.empty(counts.shape[1], np.int64)
    i = kept = 0
    while i < len(tag) and tag[i] < edges[0]:
        i += 1
    for window in range(len(counts)):
        begin, end = i, edges[window + 1]
        of_channel = counts[window]
        while i < len(tag) and tag[i] < end:
            c = channel_of[channel[i]]
            if c >= 0 and dtime[i] < bins:
                of_channel[c] += 1
            i += 1
        for c in range(len(place)):
            place[c] = kept
            kept += of_channel[c]
        for photon in range(begin, i):
            c = channel_of[channel[photon]]
            if c >= 0 and dtime[photon] < bins:
                photon_bins[place[c]] = dtime[photon]
                place[c] += 1
    return kept, i


def count_photons(
    photon_bins: NDArray[np.unsignedinteger], of_channel: NDArray[np.int64], bins: int
) -> NDArray[np.uint32]:
    """Return (channels, bins) photons a bin; the work is done without Python's lock.

    Parameters
    ----------
    photon_bins
        (photons,) bin of each, below ``bins``, channel after channel.
    of_channel
        (channels,) how many of them each channel has.
    bins
        Number of bins of a histogram.

    Raises
    ------
    ValueError
        If the photons are not as many as the channels have, or a bin is not below ``bins``.
    """
    counts = np.zeros((len(of_channel), bins), np.uint32)
    if len(photon_bins) != of_channel.sum() or not _count(photon_bins, of_channel, counts):
        raise ValueError(f"{len(photon_bins)} photons are not the {of_channel} of channels of {bins} bins")
    return counts


@njit(cache=True, nogil=True)
def _count(photon_bins, of_channel, counts):  # type: ignore[no-untyped-def]
    """Add the photons up; return whether all were within the bins."""
    i = 0
    for channel in range(len(of_channel)):
        row = counts[channel]
        for _ in range(of_channel[channel]):
            if photon_bins[i] >= len(row):
                return False
            row[photon_bins[i]] += 1
            i += 1
    return True
