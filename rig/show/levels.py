"""What is counted while optics are aligned: rates against the best so far, and the histogram of a lap."""

from collections import deque
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from rig.acquire.events import Event, Ready, StepCut, StepDone
from rig.files.description import ScanDescription

#: Detections a pulse above which early photons visibly hide late ones.
PILE_UP = 0.05
#: A histogram is shown when it has been summed for so long, or over a lap if that takes longer.
SUMMED_S = 1.0
#: Against the rate so long ago it is said whether the light rises or falls.
BEFORE_S = 1.0
#: A change by so many standard deviations is one: by chance once in 370.
CHANGED = 3.0
#: Seconds of the past that are kept, a rate each.
REMEMBERED = 60
#: A peak is told that is so many standard deviations above its surroundings.
SEEN = 6.0
#: Bins are put together until one is no wider than this part of the instrument's response.
OF_RESPONSE = 0.3


@dataclass(frozen=True)
class Peak:
    """The highest peak of a histogram.

    Attributes
    ----------
    time_s
        Its highest point, after the sync pulse.
    width_s
        Its full width at half of its height above the background; NaN where it does not fall so far.
    """

    time_s: float
    width_s: float


@dataclass(frozen=True)
class Histogram:
    """Photons of whole laps over time, all channels together.

    Attributes
    ----------
    counts
        (bins,).
    live_time_s
        For how long they were counted.
    bin_width_s, first_bin_s
        Width of a bin, and left edge of the first.
    """

    counts: NDArray[np.int64]
    live_time_s: float
    bin_width_s: float
    first_bin_s: float

    @property
    def ends_s(self) -> float:
        """Right edge of the last bin."""
        return self.first_bin_s + len(self.counts) * self.bin_width_s

    def columns(self, number: int) -> NDArray[np.float64]:
        """Return (number,) mean counts a bin, for as many even parts of the time axis."""
        edges = np.linspace(0, len(self.counts), min(number, len(self.counts)) + 1).astype(int)
        return np.asarray(np.add.reduceat(self.counts, edges[:-1]) / np.diff(edges))

    def background_hz(self, gate_s: tuple[float, float]) -> float:
        """Return the counts a second that the whole gate would have if it were as dark as its darkest fourth.

        Dark counts, ambient light, and what comes from the scene all the time.

        Parameters
        ----------
        gate_s
            Opening and closing edge after the sync pulse.
        """
        starts_s = self.first_bin_s + np.arange(len(self.counts)) * self.bin_width_s
        inside = self.counts[(starts_s >= gate_s[0]) & (starts_s + self.bin_width_s <= gate_s[1])]
        if not self.live_time_s or len(inside) < 4:
            return 0.0
        of_parts = [part.mean() for part in np.array_split(inside, min(16, len(inside)))]
        darkest = np.sort(of_parts)[: max(len(of_parts) // 4, 1)]
        return float(np.mean(darkest) * len(inside) / self.live_time_s)

    def peak(self, response_s: float) -> Peak | None:
        """Return the highest peak; None where none stands out of chance.

        Parameters
        ----------
        response_s
            Full width at half maximum of the instrument's response: bins are put together to a part of it.
        """
        together = max(int(OF_RESPONSE * response_s / self.bin_width_s), 1)
        whole = len(self.counts) // together * together
        sums = self.counts[:whole].reshape(-1, together).sum(axis=1)
        if not len(sums):
            return None
        top, floor = int(sums.argmax()), float(np.median(sums))
        if sums[top] - floor <= SEEN * sqrt(floor + 1):
            return None
        half = (sums[top] + floor) / 2
        step_s = together * self.bin_width_s
        after, before = _falls_to(sums[top:], half), _falls_to(sums[top::-1], half)
        return Peak(self.first_bin_s + (top + 0.5) * step_s, (after + before) * step_s)


def _falls_to(values: NDArray[np.int64], half: float) -> float:
    """Return after how many values, between two of them, a peak has fallen to its half; NaN if it has not."""
    below = np.flatnonzero(values <= half)
    if not len(below):
        return float("nan")
    last = int(below[0])
    high, low = float(values[last - 1]), float(values[last])
    return last - 1 + (high - half) / (high - low)


class Levels:
    """A consumer of scan events that knows the levels now, and the best so far.

    The rate is that of the last exposure of each spot of a lap, so that it hardly waits, and yet does not
    change because the beam goes round.

    Parameters
    ----------
    of_a_lap
        Spots of a lap.

    Attributes
    ----------
    names
        Of the channels.
    gate_s
        When the detector is sensitive, after the sync pulse; the whole histogram where it runs freely.
    sync_hz, dark_hz
        Rate of the sync pulses, and of detections before there was light (None: not known).
    photons, live_time_s
        All that was counted, and for how long.
    best_hz
        Highest rate of a lap.
    minute_hz
        Rate of each of the last seconds.
    histogram
        Of the last laps; None before the first is whole.
    """

    def __init__(self, of_a_lap: int) -> None:
        self._of_a_lap = of_a_lap
        self._latest: deque[tuple[NDArray[np.int64], float]] = deque(maxlen=of_a_lap)
        self._before: deque[tuple[float, float, float]] = deque()
        self._second, self._laps = Sum(), Sum()
        self._axis = (0.0, 0.0)
        self.names: tuple[str, ...] = ()
        self.gate_s = (0.0, 0.0)
        self.sync_hz = 0.0
        self.dark_hz: float | None = None
        self.photons, self.live_time_s = 0, 0.0
        self.best_hz = 0.0
        self.minute_hz: deque[float] = deque(maxlen=REMEMBERED)
        self.histogram: Histogram | None = None

    def begun(self, description: ScanDescription) -> None:
        """Learn the time axis and the channels."""
        self._axis = description.bin_width_s, description.first_bin_s
        opens_s, closes_s = description.gate_start_s, description.gate_stop_s
        ends_s = description.first_bin_s + description.bins * description.bin_width_s
        self.gate_s = (description.first_bin_s, ends_s)
        if opens_s is not None and closes_s is not None:
            self.gate_s = (opens_s, closes_s)
        self.names = tuple(channel.name for channel in description.channels)

    def __call__(self, event: Event) -> None:
        """Count what was measured."""
        match event:
            case Ready(rates=rates, dark_hz=dark_hz):
                self.sync_hz, self.dark_hz = rates.sync_hz, dark_hz
            case StepDone(exposure=exposure) | StepCut(exposure=exposure) if exposure.live_time_s > 0:
                self._count(exposure.counts.astype(np.int64), exposure.live_time_s)

    def _count(self, counts: NDArray[np.int64], live_s: float) -> None:
        self._latest.append((counts.sum(axis=1), live_s))
        self.photons += int(counts.sum())
        self.live_time_s += live_s
        self._second.add(counts.sum(), live_s)
        if self._second.live_time_s >= SUMMED_S:
            self.minute_hz.append(float(self._second.total) / self._second.live_time_s)
            self._second = Sum()
        self._laps.add(counts.sum(axis=0), live_s)
        if self._laps.live_time_s >= SUMMED_S and self._laps.steps % self._of_a_lap == 0:
            summed = np.asarray(self._laps.total)
            self.histogram, self._laps = Histogram(summed, self._laps.live_time_s, *self._axis), Sum()
        if len(self._latest) == self._of_a_lap:
            self.best_hz = max(self.best_hz, self.now_hz)
            self._before.append((self.live_time_s, self.now_hz, self._sigma_hz))
            while len(self._before) > 1 and self._before[1][0] <= self.live_time_s - self._apart_s:
                self._before.popleft()

    @property
    def _latest_s(self) -> float:
        return sum(live_s for _, live_s in self._latest)

    @property
    def _apart_s(self) -> float:
        """How long ago the rate was to which that of now is compared; no photon may be in both."""
        return max(BEFORE_S, self._latest_s)

    @property
    def _sigma_hz(self) -> float:
        """Standard deviation of the rate now."""
        return sqrt(self.now_hz * self._latest_s + 1) / self._latest_s

    @property
    def channels_hz(self) -> NDArray[np.float64]:
        """(channels,) counts a second of each channel now."""
        if not self._latest_s:
            return np.zeros(len(self.names))
        return np.asarray(sum(photons for photons, _ in self._latest) / self._latest_s)

    @property
    def now_hz(self) -> float:
        """Counts a second now, of all channels together."""
        return float(self.channels_hz.sum())

    @property
    def mean_hz(self) -> float:
        """Counts a second since the beginning."""
        return self.photons / self.live_time_s if self.live_time_s else 0.0

    @property
    def strongest(self) -> tuple[str, float]:
        """Name and rate of the channel that counts most."""
        most = int(self.channels_hz.argmax())
        return self.names[most], float(self.channels_hz[most])

    @property
    def of_pulses(self) -> float:
        """Detections a sync pulse, of the channel that counts most."""
        return self.strongest[1] / self.sync_hz if self.sync_hz else 0.0

    @property
    def background_hz(self) -> float | None:
        """Counts a second in the gate, were it all as dark as its darkest fourth; None: not known yet."""
        return None if self.histogram is None else self.histogram.background_hz(self.gate_s)

    @property
    def of_best(self) -> float:
        """Rate now as a part of the best."""
        return self.now_hz / self.best_hz if self.best_hz else 0.0

    @property
    def trend(self) -> int:
        """1 where the rate rises, -1 where it falls, 0 where a change can be chance."""
        if not self._before or self.live_time_s - self._before[0][0] < self._apart_s:
            return 0
        _, before_hz, sigma_hz = self._before[0]
        change_hz = self.now_hz - before_hz
        if abs(change_hz) <= CHANGED * sqrt(sigma_hz**2 + self._sigma_hz**2):
            return 0
        return 1 if change_hz > 0 else -1


class Sum:
    """Photons and measurement time of some steps."""

    def __init__(self) -> None:
        self.total: NDArray[np.int64] | np.int64 = np.int64(0)
        self.live_time_s = 0.0
        self.steps = 0

    def add(self, counts: NDArray[np.int64] | np.int64, live_s: float) -> None:
        """Add a step."""
        self.total = self.total + counts
        self.live_time_s += live_s
        self.steps += 1
