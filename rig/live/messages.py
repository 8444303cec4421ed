"""What a scan tells those who look on: its events, with photons in place of exposures, in blocks."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.acquire.events import Ended, Grown, LightChanged, Noticed, PhaseChanged, Ready
from rig.files.description import ScanDescription
from rig.live.web.address import Address
from rig.model.devices import Exposure
from rig.model.photons import TaggedExposure, photons_in


@dataclass(frozen=True)
class Film:
    """How the frames of a scan are shown.

    Attributes
    ----------
    fresh_to_m
        Depth up to which a frame is shown alone (`recon.frames`); None averages none.
    video
        Where a video of all is written at the end; None for nowhere.
    """

    fresh_to_m: float | None = None
    video: Path | None = None


#: Each frame alone, and no video.
PLAIN = Film()


@dataclass(frozen=True)
class Next:
    """The commands that follow a scan, as a person types them.

    Attributes
    ----------
    resume
        Goes on with one that was interrupted.
    recon
        Images one that is complete.
    """

    resume: str = ""
    recon: str = ""


@dataclass(frozen=True)
class Begun:
    """The first message.

    Attributes
    ----------
    description
        All that is known before the first photon.
    scan
        The scan file; what was not sent is read from it.
    folder
        Where pictures are written.
    window
        Whether somebody would look at a window.
    film
        How frames are shown, if there are several.
    web
        Where a page is served; None for nowhere.
    then
        Which commands follow.
    reads
        Whether all is read from a scan file, and not sent by the program that scans.
    """

    description: ScanDescription
    scan: Path
    folder: Path
    window: bool
    film: Film = PLAIN
    web: Address | None = None
    then: Next = Next()
    reads: bool = False


@dataclass(frozen=True)
class Block:
    """The photons of some steps that follow one another.

    Attributes
    ----------
    first
        The first of the steps.
    offset
        (steps * channels + 1,) where the photons of each step and channel begin, and the end.
    photon_bins
        (photons,) the bin of each.
    live_time_s
        (steps,) how long each was measured.
    when_s
        Seconds since 1970 at which the last of them was there; NaN where they were measured earlier.
    """

    first: int
    offset: NDArray[np.int64]
    photon_bins: NDArray[np.unsignedinteger]
    live_time_s: NDArray[np.float64]
    when_s: float

    @property
    def steps(self) -> slice:
        """Which steps."""
        return slice(self.first, self.first + len(self.live_time_s))

    @property
    def nbytes(self) -> int:
        """Memory that the photons take."""
        return self.offset.nbytes + self.photon_bins.nbytes + self.live_time_s.nbytes


@dataclass(frozen=True)
class Gap:
    """Steps that were measured and not sent, because who looks on was too slow; the scan file has them."""

    first: int
    stop: int


Told = PhaseChanged | Ready | LightChanged | Noticed | Grown | Ended
Message = Begun | Block | Gap | Told


class BlockBuilder:
    """Puts exposures together to a block.

    Attributes
    ----------
    nbytes
        What the photons at hand take.
    """

    def __init__(self) -> None:
        self._clear()

    def _clear(self) -> None:
        self._first = -1
        self._photons: list[NDArray[np.unsignedinteger]] = []
        self._of_channel: list[NDArray[np.int64]] = []
        self._live_s: list[float] = []
        self.nbytes = 0

    def __len__(self) -> int:
        """Return the number of steps at hand."""
        return len(self._live_s)

    def follows(self, step: int) -> bool:
        """Return whether a step comes next to those at hand."""
        return not self._live_s or step == self._first + len(self._live_s)

    def add(self, step: int, exposure: Exposure) -> None:
        """Add the next step; the exposure may be reused afterwards."""
        if not self._live_s:
            self._first = step
        photons, of_channel = photons_of(exposure)
        self._photons.append(photons)
        self._of_channel.append(of_channel)
        self._live_s.append(exposure.live_time_s)
        self.nbytes += photons.nbytes

    def take(self, when_s: float) -> Block:
        """Return the block, and begin anew."""
        offset = np.concatenate([[0], np.cumsum(np.concatenate(self._of_channel))]).astype(np.int64)
        block = Block(self._first, offset, np.concatenate(self._photons), np.array(self._live_s), when_s)
        self._clear()
        return block


def say(line: str) -> None:
    """Tell the program that scans, on standard output, if it is still there."""
    with suppress(OSError, ValueError):
        print(" ".join(line.split()), flush=True)


def photons_of(exposure: Exposure) -> tuple[NDArray[np.unsignedinteger], NDArray[np.int64]]:
    """Return the bin of each photon, channel after channel, and how many each channel has; copies."""
    if isinstance(exposure, TaggedExposure):
        return exposure.photon_bins.copy(), exposure.of_channel.copy()
    return photons_in(np.atleast_2d(exposure.counts))
