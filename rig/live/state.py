"""What is known of a scan that is under way, apart from how it is shown.

`LiveState` takes the messages of a scan, one after another, and holds what a person wants to know. It is a
function of these messages alone: neither clock nor file is asked. `seen` gives what is there as a value of
its own, for whatever draws it, in another thread too.
"""

import threading
from dataclasses import dataclass, replace
from math import isnan

import numpy as np
from numpy.typing import NDArray

from recon.accumulate import Picture
from recon.capture import Capture
from rig.acquire.events import Ended, Grown, LightChanged, Noticed, PhaseChanged, Ready
from rig.files.description import ScanDescription
from rig.image.until import expected, rounds_of
from rig.live.messages import Block, Gap, Message
from rig.model.devices import Rates
from rig.model.sweep import planned_duration_s

#: Bins of the histogram of all positions at most: more than a picture has pixels for them.
HISTOGRAM_BINS = 1500
#: Moments at which the rate is kept at most; neighbours are put together when there are more.
MOMENTS = 400
#: Least exposure of a moment, as a part of the usual.
ENOUGH = 0.25
#: Warnings that are kept, the newest.
WARNINGS = 20


@dataclass(frozen=True)
class Subject:
    """What is known of a scan before its first photon.

    Attributes
    ----------
    name, rig, exposure_s, order, motion
        The scan file's name, the rig's, exposure and order of the steps, and how the mirror moves.
    steps, channels
        How many there are.
    frames, frame_s, endless
        How often all positions are visited, how long that takes each time, as the plan has it, and whether
        more frames are added until somebody stops the scan.
    laser_m
        (P, 3) laser spot of each step of a frame.
    capture
        Geometry and time axis of all pairs of step and channel that are to come in a frame.
    rounds
        Number of steps by the end of each round; of a scan of one frame.
    fade_from_s, response_s
        Rectified time before which there is the wall's own light, and the instrument's response, if known.
    gate_s
        Rectified times of the gate's opening and closing edge, each (earliest, latest) over the wall; empty
        where there is no gate.
    rectified
        Whether the time axis is rectified: path delays, or none to be taken off, are known.
    """

    name: str
    rig: str
    exposure_s: float
    order: str
    motion: str
    steps: int
    channels: int
    frames: int
    frame_s: float
    endless: bool
    laser_m: NDArray[np.float64]
    capture: Capture
    rounds: tuple[int, ...]
    fade_from_s: float | None
    response_s: float | None
    gate_s: tuple[tuple[float, float], ...]

    @property
    def frame_steps(self) -> int:
        """Number of steps of a frame."""
        return self.steps // self.frames

    @classmethod
    def of(cls, name: str, description: ScanDescription) -> "Subject":
        """Take from a scan's description what matters here."""
        plan, state = description.plan, description.state
        assert plan is not None
        one, frames = plan.passes[0], plan.frames
        laser_m = description.laser_m[: description.steps // frames]
        capture = expected(replace(description, laser_m=laser_m))
        duration_s = plan.exposure_total_s if state is None else planned_duration_s(plan, state)
        shift_s = capture.first_bin_s - description.first_bin_s
        edges_s = [edge for edge in (description.gate_start_s, description.gate_stop_s) if edge is not None]
        return cls(
            name=name,
            rig=state.config.name if state else "",
            exposure_s=one.exposure_s,
            order=getattr(one.positions, "order", "list"),
            motion=one.motion,
            steps=description.steps,
            channels=description.channel_count,
            frames=frames,
            frame_s=duration_s / frames,
            endless=plan.endless,
            laser_m=laser_m,
            capture=capture,
            rounds=rounds_of(plan) if len(plan.passes) == 1 else (description.steps,),
            fade_from_s=description.fade_from_s,
            response_s=description.instrument_response_s,
            gate_s=tuple((float((e + shift_s).min()), float((e + shift_s).max())) for e in edges_s),
        )


@dataclass(frozen=True)
class Seen:
    """All that is known of a scan at a moment.

    Attributes
    ----------
    phase
        What the engine is doing.
    light
        What was last known of the laser's light; None before.
    rates
        Sync and count rates before the first exposure; None before.
    warnings
        The newest, each with the first and the last step that it concerns.
    photons
        (P,) photons of each step of a frame when it was last visited, NaN where it was not measured.
    total
        Photons of all steps.
    histogram
        (B,) photons of all steps over time.
    histogram_edges_s
        (B + 1,) rectified times.
    moments_s, photons_per_s
        When photons came, in seconds since the first, and how many a second of exposure.
    measured
        Number of steps that were measured.
    began_s, newest_s
        Seconds since 1970 at which the first and the newest photons came; NaN before.
    left_s
        How long the rest will take, by the pace until now; None while that is not known.
    ended
        How the scan ended; None while it runs.
    lost
        Whether the program that scans is gone without a word.
    picture, title
        The newest live image, None before the first, and what it is of.
    final
        Whether it is the last one, made of all positions with the wavelength for all of them.
    """

    phase: str
    light: LightChanged | None
    rates: Rates | None
    warnings: tuple[Noticed, ...]
    photons: NDArray[np.float64]
    total: int
    histogram: NDArray[np.int64]
    histogram_edges_s: NDArray[np.float64]
    moments_s: NDArray[np.float64]
    photons_per_s: NDArray[np.float64]
    measured: int
    began_s: float
    newest_s: float
    left_s: float | None
    ended: Ended | None
    lost: bool
    picture: Picture | None
    title: str
    final: bool

    @property
    def ends_s(self) -> float | None:
        """Seconds since 1970 at which the scan will end, by the pace until now."""
        return None if self.left_s is None or self.ended else self.newest_s + self.left_s


class RateHistory:
    """Photons a second over time in bounded memory: two neighbours become one when there are too many."""

    def __init__(self) -> None:
        self._width_s = 0.5
        self._sums = np.zeros((0, 2))  # photons and live time, by time

    def add(self, at_s: float, photons: int, live_s: float) -> None:
        """Add what came by a time after the first."""
        while (number := int(at_s / self._width_s)) >= MOMENTS:
            even = np.pad(self._sums, ((0, len(self._sums) % 2), (0, 0)))
            self._sums, self._width_s = even[::2] + even[1::2], 2 * self._width_s
        if number >= len(self._sums):
            self._sums = np.pad(self._sums, ((0, number + 1 - len(self._sums)), (0, 0)))
        self._sums[number] += photons, live_s

    def curve(self) -> tuple[NDArray, NDArray]:
        """Return times in seconds, and photons a second of exposure, where enough was measured.

        A moment with few positions says more of these than of the rate, and is left out.
        """
        photons, live_s = self._sums.T
        measured = live_s[live_s > 0]
        there = live_s > (ENOUGH * np.median(measured) if len(measured) else 0)
        times_s = (np.arange(len(self._sums)) + 0.5) * self._width_s
        return times_s[there], photons[there] / live_s[there]


class LiveState:
    """What is known of a scan that is under way; safe to use from several threads.

    Parameters
    ----------
    subject
        What was known before.

    Attributes
    ----------
    missing
        (S,) steps that were measured and whose photons are not here: they are in the scan file.
    """

    def __init__(self, subject: Subject) -> None:
        self.subject = subject
        self._lock = threading.Lock()
        capture = subject.capture
        self._begins_s = np.broadcast_to(capture.first_bin_s, capture.positions)
        first_s, last_s = float(self._begins_s.min()), float(self._begins_s.max())
        last_s += capture.bins * capture.bin_width_s
        count = min(HISTOGRAM_BINS, capture.bins)
        self._edges_s = np.linspace(first_s, last_s, count + 1)
        self._histogram = np.zeros(count, np.int64)
        self._photons = np.full(subject.frame_steps, np.nan)
        self._here, self.missing = np.zeros((2, subject.steps), bool)
        self._total = 0
        self._history = RateHistory()
        self._phase, self._light, self._rates = "", None, None
        self._warnings: dict[str, Noticed] = {}
        self._first_s = self._newest_s = float("nan")
        self._since_s, self._paced = float("nan"), 0  # of this run: when its first came, steps after that
        self._ended: Ended | None = None
        self._lost = False
        self._picture: Picture | None = None
        self._title, self._final = "", False

    _light: LightChanged | None
    _rates: Rates | None

    def __call__(self, message: Message) -> None:
        """Take a message."""
        with self._lock:
            self._take(message)

    def _take(self, message: Message) -> None:
        match message:
            case Block():
                self._count(message)
            case Gap(first=first, stop=stop):
                self.missing[first:stop] = True
            case PhaseChanged(phase=phase):
                self._phase = phase.value
            case Ready(rates=rates, warnings=warnings):
                self._rates = rates
                at = int(np.count_nonzero(self._here))
                for sentence in warnings:
                    self._warn(Noticed(sentence, at, at))
            case LightChanged():
                self._light = message
            case Noticed():
                self._warn(message)
            case Grown(plan=plan):
                self._grow(len(plan))
            case Ended(steps_done=trusted):
                self._ended = message
                back = np.flatnonzero(self._here[trusted:]) + trusted
                self._photons[back % len(self._photons)] = np.nan
                self._here[trusted:] = self.missing[trusted:] = False

    def _warn(self, said: Noticed) -> None:
        before = self._warnings.pop(said.sentence, said)  # the newest come last
        self._warnings[said.sentence] = replace(
            said, first=min(before.first, said.first), when_s=before.when_s
        )
        while len(self._warnings) > WARNINGS:
            del self._warnings[next(iter(self._warnings))]

    def _grow(self, steps: int) -> None:
        """Take more frames."""
        more = np.zeros(steps - len(self._here), bool)
        self._here, self.missing = (np.concatenate([one, more]) for one in (self._here, self.missing))

    def _count(self, block: Block) -> None:
        """Add the photons of a block."""
        steps, channels = block.steps, self.subject.channels
        of_pair = np.diff(block.offset)
        places = np.arange(steps.start, steps.stop) % len(self._photons)
        self._photons[places] = of_pair.reshape(-1, channels).sum(axis=1)
        self._total += len(block.photon_bins)
        self._here[steps], self.missing[steps] = True, False
        capture = self.subject.capture
        begins_s = np.repeat(self._begins_s.reshape(-1, channels)[places].ravel(), of_pair)
        times_s = begins_s + (block.photon_bins + 0.5) * capture.bin_width_s - self._edges_s[0]
        width_s = self._edges_s[1] - self._edges_s[0]
        number = np.minimum((times_s / width_s).astype(np.int64), len(self._histogram) - 1)
        self._histogram += np.bincount(number, minlength=len(self._histogram))
        if not isnan(block.when_s):
            self._pace(block)

    def _pace(self, block: Block) -> None:
        """Note when the photons of a block came."""
        live_s = float(np.nansum(block.live_time_s))
        if isnan(self._first_s):
            self._first_s = block.when_s - live_s
        self._paced += len(block.live_time_s)
        self._newest_s = block.when_s
        self._history.add(max(0.0, block.when_s - self._first_s), len(block.photon_bins), live_s)

    def show(self, picture: Picture, title: str, *, final: bool = False) -> None:
        """Take the newest live image, and what it is of."""
        with self._lock:
            self._picture, self._title, self._final = picture, title, final

    def lose(self) -> None:
        """Take that the program that scans is gone without a word."""
        with self._lock:
            self._lost = self._ended is None

    def forget_photons(self) -> None:
        """Forget all photons; what is measured is to be read from the scan file again."""
        with self._lock:
            self.missing |= self._here
            self._here[:] = False
            self._photons[:] = np.nan
            self._histogram[:], self._total = 0, 0

    def seen(self) -> Seen:
        """Return what is known now."""
        with self._lock:
            measured = int(np.count_nonzero(self._here | self.missing))
            left_s = None
            if self._paced and not self.subject.endless:
                passed_s = self._newest_s - self._first_s
                left_s = passed_s / self._paced * (self.subject.steps - measured)
            moments_s, photons_per_s = self._history.curve()
            return Seen(
                phase=self._phase,
                light=self._light,
                rates=self._rates,
                warnings=tuple(self._warnings.values()),
                photons=self._photons.copy(),
                total=self._total,
                histogram=self._histogram.copy(),
                histogram_edges_s=self._edges_s,
                moments_s=moments_s,
                photons_per_s=photons_per_s,
                measured=measured,
                began_s=self._first_s,
                newest_s=self._newest_s,
                left_s=left_s,
                ended=self._ended,
                lost=self._lost,
                picture=self._picture,
                title=self._title,
                final=self._final,
            )
