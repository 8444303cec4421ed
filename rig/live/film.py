"""The live images of a scan of several frames: each frame by itself, as soon as it is whole.

They are made as `rig recon --each-frame` makes them, with a wave that is coarse enough for the time there is.
All frames are taken, so that those which are averaged follow one another; which of them are looked at is up
to the time that there is.
"""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from math import ceil, isfinite
from pathlib import Path
from time import time

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from recon import defaults
from recon.accumulate import Picture
from recon.depth import compensate_falloff, front_view
from recon.frames import FrameImager
from recon.glance import MOST_CELLS
from recon.noise import quiet_level
from recon.sparse import Photons
from recon.surface import find
from recon.virtual_aperture import remapped
from recon.wave import VirtualPulse
from recon.window import Window
from rig.errors import DataFileError, UsageError
from rig.files.volume import Volume
from rig.live.messages import Block, Film, say
from rig.live.state import Subject
from rig.model.quantities import show_duration
from rig.show.saving import save
from rig.show.sheet import COLOURS
from rig.show.video import save_video
from rig.show.volume import draw_front

#: Frames whose pictures, and whose part of the video, are kept: the newest.
KEPT = 1000
#: Size of a frame's picture [inches].
SIZE_IN = (5.0, 4.6)


@dataclass(frozen=True)
class Whole:
    """A frame of which all photons are there.

    Attributes
    ----------
    number
        Which, counted from 0.
    photons
        Of its pairs in order.
    when_s
        Seconds since 1970 at which the scan had its last photon; NaN where that is not known.
    """

    number: int
    photons: Photons
    when_s: float


class Gathering:
    """Puts blocks together to frames. A frame of which a part was left out is missed.

    Parameters
    ----------
    steps, channels
        Of a frame.
    """

    def __init__(self, steps: int, channels: int) -> None:
        self._steps, self._channels = steps, channels
        self._next = -1  # the step that goes on with what is at hand; none is
        self._bins: list[NDArray[np.unsignedinteger]] = []
        self._of_pair: list[NDArray[np.int64]] = []

    def add(self, block: Block) -> Iterator[Whole]:
        """Take a block, and yield the frames that are whole with it."""
        first, stop = block.steps.start, block.steps.stop
        while first < stop:
            end = min(stop, (first // self._steps + 1) * self._steps)
            self._take(block, first, end)
            if self._next == end and end % self._steps == 0:
                yield self._whole(end, block.when_s)
            first = end

    def _take(self, block: Block, first: int, stop: int) -> None:
        """Take steps of one frame, if all that is before them in it is there."""
        if first % self._steps == 0:
            self._bins, self._of_pair = [], []
        elif first != self._next:
            self._next = -1
            return
        pairs = slice((first - block.first) * self._channels, (stop - block.first) * self._channels + 1)
        edges = block.offset[pairs]
        self._bins.append(block.photon_bins[edges[0] : edges[-1]])
        self._of_pair.append(np.diff(edges))
        self._next = stop

    def _whole(self, end: int, when_s: float) -> Whole:
        bins = np.concatenate(self._bins).astype(np.int32)
        offset = np.concatenate([[0], np.cumsum(np.concatenate(self._of_pair))]).astype(np.int64)
        return Whole(end // self._steps - 1, Photons(offset, bins, np.ones(len(bins), np.float32)), when_s)


class Filming:
    """Images frames while they are measured, writes a picture of each, and a video of all at the end.

    Parameters
    ----------
    subject
        What is known of the scan.
    wish
        How frames are averaged, and whether there is to be a video.
    folder
        Where pictures go; None for nowhere.
    tell
        Takes lines as the program that scans does.

    Attributes
    ----------
    least_s
        How long it is waited at least between two images: not at all.
    title
        What the newest image is of.

    Raises
    ------
    recon.errors.ReconError
        If no image can be made of such a scan.
    """

    least_s = 0.0

    def __init__(
        self, subject: Subject, wish: Film, folder: Path | None, tell: Callable[[str], None] = say
    ) -> None:
        self._subject, self._wish, self._folder, self._tell = subject, wish, folder, tell
        self._gathering = Gathering(subject.frame_steps, subject.channels)
        capture = remapped(subject.capture)
        pitch_m = defaults.spacing_m(capture)
        wide_m = float(np.ptp(capture.laser_m, axis=0).max())
        side_m = max(1, ceil(wide_m / pitch_m / MOST_CELLS)) * pitch_m
        shortest_m = defaults.wavelength(capture, subject.response_s).value
        self.pulse = VirtualPulse(max(2 * side_m, shortest_m))
        self.grid = defaults.voxels(capture, self.pulse, voxel_m=side_m)
        window = Window(start_s=subject.fade_from_s)
        self._imager = FrameImager(capture, self.pulse, self.grid, window, fresh_to_m=wish.fresh_to_m)
        self._newest: Whole | None = None  # that was taken
        self._fronts: deque[tuple[int, NDArray[np.float32]]] = deque(maxlen=KEPT)
        self._late_s: list[float] = []
        self._first = -1  # frame with which this run began
        self._drawn = FramePicture(self.grid.x_m, self.grid.y_m)
        self.title = ""

    #: A film has no end that is known before the scan's.
    whole = False

    def add(self, block: Block) -> bool:
        """Add the photons of a block; return whether there is a frame that was not looked at."""
        if self._first < 0:
            self._first = -(-block.first // self._subject.frame_steps)
        for whole in self._gathering.add(block):
            after = whole.number - (self._newest.number if self._newest is not None else -1)
            if after < 1:  # it was left out, and read from the file when others had been shown
                continue
            if after > 1:
                self._imager.forget()
            self._imager.take(whole.photons)
            self._newest = whole
        return self._newest is not None and not self._looked_at(self._newest)

    def _looked_at(self, frame: Whole) -> bool:
        return bool(self._fronts) and self._fronts[-1][0] == frame.number

    def picture(self) -> Picture:
        """Image the newest frame, and write its picture."""
        frame = self._newest
        assert frame is not None
        found = self._imager.look()
        lifted = compensate_falloff(found.intensity, found.grid.z_m, found.falloff_power)
        front = front_view(lifted)
        self._fronts.append((frame.number, front))
        of = "" if self._subject.endless else f" of {self._subject.frames}"
        self.title = f"frame {frame.number + 1}{of}"
        self._write(frame.number, np.sqrt(front))
        late_s = time() - frame.when_s
        if isfinite(late_s):
            self._late_s.append(late_s)
            self.title += f", {show_duration(late_s)} after its last photon"
        surface = find(found, quiet_level(found.intensity))
        return Picture(self._subject.capture.positions, self.pulse, found.grid, np.sqrt(front), surface)

    def _write(self, number: int, front: NDArray[np.float32]) -> None:
        """Write a frame's picture; one that cannot be written is missed, as others say."""
        if self._folder is None:
            return
        path, old = (self._folder / f"frame-{one + 1:05d}.png" for one in (number, number - KEPT))
        with suppress(DataFileError, UsageError, OSError):
            self._folder.mkdir(exist_ok=True)
            self._drawn.save(front, f"{self._subject.name}: {self.title}", path)
            old.unlink(missing_ok=True)

    def last(self, steps: int) -> Picture | None:
        """Look at the newest frame, if that was not done; write the video; tell how it went.

        Parameters
        ----------
        steps
            How many can be trusted.
        """
        newest = self._newest
        picture = self.picture() if newest is not None and not self._looked_at(newest) else None
        whole = steps // self._subject.frame_steps
        self._write_video([one for one in self._fronts if one[0] < whole])
        if shown := len(self._late_s):
            come = max(whole - self._first, shown)
            skipped = f"; there was no time for {come - shown}" if come > shown else ""
            late = f"{show_duration(float(np.median(self._late_s)))} after its last photon in the median, "
            self._tell(f"fact {shown} of {come} frames were shown{skipped}: each {late}"
                f"{show_duration(max(self._late_s))} at most")  # fmt: skip
        return picture

    def _write_video(self, fronts: list[tuple[int, NDArray[np.float32]]]) -> None:
        if self._wish.video is None or not fronts:
            return
        numbers, views = zip(*fronts, strict=True)
        grid, wave = self.grid, {"wavelength_m": self.pulse.wavelength_m, "cycles": self.pulse.cycles}
        volume = Volume(
            np.stack(views).astype(np.float32),
            grid.x_m,
            grid.y_m,
            grid.z_m,
            t_s=np.array(numbers) * self._subject.frame_s,
            parameters={"camera": "confocal", "solver": "rsd", **wave, "each_frame": True},
            scan=self._subject.name,
        )
        try:
            save_video(volume, self._wish.video, compensation="z\u2074")
        except (DataFileError, UsageError, OSError) as error:
            self._tell(f"trouble {error}")


class FramePicture:
    """Draws frames one after the other, each to its own greatest amplitude.

    Parameters
    ----------
    x_m, y_m
        Pixel centres.
    """

    def __init__(self, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> None:
        self._figure = Figure(figsize=SIZE_IN, layout="constrained")
        FigureCanvasAgg(self._figure)
        self._axes = self._figure.add_subplot()
        nothing = np.zeros((len(y_m), len(x_m)))
        self._drawn = draw_front(self._axes, nothing, x_m, y_m, COLOURS, Normalize(0.0, 1.0))
        self._figure.colorbar(self._drawn, ax=self._axes, label="amplitude / maximum")

    def save(self, front: NDArray[np.float32], title: str, path: Path) -> None:
        """Write a frame."""
        largest = float(front.max())
        self._drawn.set_array(front / largest if largest > 0 else front)
        self._axes.set_title(title, size=11)
        save(self._figure, path)
