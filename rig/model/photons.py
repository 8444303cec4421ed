"""An exposure as its photons, one by one: what a time-tagged instrument gives in place of histograms."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class TaggedExposure:
    """The photons of one step; satisfies `rig.model.devices.Exposure`.

    Attributes
    ----------
    photon_bins
        (photons,) uint16 or uint32, the bin of each photon, channel after channel, in order of time in each.
    of_channel
        (channels,) how many of them each channel has.
    bins
        Number of bins of a histogram.
    live_time_s
        How long was measured.
    warnings
        Plain sentences about this measurement.
    whole
        Whether it lasted as long as was asked for.
    """

    photon_bins: NDArray[np.unsignedinteger]
    of_channel: NDArray[np.int64]
    bins: int
    live_time_s: float
    warnings: tuple[str, ...] = ()
    whole: bool = True

    @property
    def photons(self) -> int:
        """Number of photons."""
        return len(self.photon_bins)

    @cached_property
    def counts(self) -> NDArray[np.uint32]:
        """(channels, bins) photons a bin; made when it is first asked for."""
        from rig.model.sorting import count_photons  # compiled code, for which readers of files do not wait

        return count_photons(self.photon_bins, self.of_channel, self.bins)


def photons_in(counts: NDArray[np.integer]) -> tuple[NDArray[np.unsignedinteger], NDArray[np.int64]]:
    """Return the bin of each photon of (rows, bins) counts, row after row, and how many each row has."""
    bins = counts.shape[-1]
    filled = np.flatnonzero(counts)
    times = counts.reshape(-1)[filled]
    small = np.uint16 if bins <= 2**16 else np.uint32
    return np.repeat((filled % bins).astype(small), times), counts.sum(axis=-1, dtype=np.int64)
