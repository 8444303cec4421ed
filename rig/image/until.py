"""A scan that ends by itself: when its picture has stopped changing, is clear enough, or time is up.

A scan that is taken up again is judged as if it had not been interrupted: what it holds is read from its file
before anything moves. Its time counts from the first exposure that is new.
"""

import threading
import time
from dataclasses import dataclass
from itertools import pairwise
from queue import Queue
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from recon.accumulate import Coming, GrowingPicture, Picture, likeness
from recon.capture import ArrayHistograms, Capture
from recon.window import Window
from rig.acquire.events import Ended, Event, LineDone, StepDone
from rig.errors import UsageError
from rig.files.description import ScanDescription
from rig.files.scan import ScanFile
from rig.model.plan import Grid, ScanPlan
from rig.model.quantities import parse, show

#: Histograms that wait for the picture at most. A slower computer gives up the picture; the scan never waits.
WAITING_BYTES = 2**29
#: Steps that are read from a scan file at once.
STEPS_AT_ONCE = 64


@dataclass(frozen=True)
class Rule:
    """When a scan is to end.

    Attributes
    ----------
    kind
        likeness: of the pictures of two rounds that follow one another (`recon.accumulate.likeness`).
        contrast: median of the surface seen, over the photons' noise. time: since the first exposure began.
    value
        From which on; the time in seconds.
    """

    kind: Literal["likeness", "contrast", "time"]
    value: float

    @classmethod
    def from_text(cls, text: str, plan: ScanPlan) -> "Rule":
        """Read a rule like ``likeness 0.99``, ``contrast 30`` or ``time 60s``.

        Raises
        ------
        UsageError
            If it is none, or the plan has no rounds whose pictures could be judged.
        """
        kind, _, value = text.strip().partition(" ")
        if kind == "time":
            rule = cls("time", parse(value, "time"))
        elif kind == "likeness":
            rule = cls("likeness", _number(text, value, 1.0))
        elif kind == "contrast":
            rule = cls("contrast", _number(text, value, float("inf")))
        else:
            raise _no_rule(text)
        if not rule.value > 0:
            raise _no_rule(text)
        if kind != "time" and len(rounds_of(plan)) < 2:
            raise UsageError(
                f"--until '{text}' compares the pictures of rounds that each see the whole wall, "
                "but this scan has only one; add --order progressive"
            )
        return rule


def _number(text: str, value: str, most: float) -> float:
    try:
        number = float(value)
    except ValueError:
        raise _no_rule(text) from None
    if not number < most:
        raise _no_rule(text)
    return number


def _no_rule(text: str) -> UsageError:
    return UsageError(
        f"--until '{text}' is not a rule; write 'likeness 0.99' (below 1), 'contrast 30' or 'time 60s'"
    )


def rounds_of(plan: ScanPlan) -> tuple[int, ...]:
    """Return how many positions are measured by the end of each round."""
    positions = plan.passes[0].positions
    return positions.rounds if isinstance(positions, Grid) else (len(positions.spots_m),)


class Until:
    """A consumer of scan events that says when the rule is met.

    Pictures are made in a thread of their own, one at the end of each round.

    Parameters
    ----------
    rule
        What is waited for.
    """

    def __init__(self, rule: Rule) -> None:
        self._rule = rule
        self._reason = ""
        self.trouble = ""
        self._began_s: float | None = None
        self._line: list[NDArray] = []
        self._lines: Queue[tuple[int, NDArray] | None] = Queue()
        self._thread: threading.Thread | None = None
        self._judge: _Judge | None = None

    def reason(self) -> str:
        """Return why the scan is to end, or nothing while it is not."""
        if self._rule.kind == "time" and not self._reason and self._began_s is not None:
            passed_s = time.monotonic() - self._began_s
            if passed_s >= self._rule.value:
                self._reason = f"time {passed_s:.1f} s of the {show(self._rule.value, 's')} requested"
        return self._reason

    def take_up(self, scan: ScanFile) -> None:
        """Judge what an interrupted scan holds already, by its newest round; the rule may be met by that."""
        if self._rule.kind == "time":
            return
        judge = self._judge = _Judge(self._rule, scan)
        measured = scan.steps if scan.done.all() else int(scan.done.argmin())
        looked_at = [end for end in judge.ends if end <= measured][-2:]
        edges = sorted({*range(0, measured, STEPS_AT_ONCE), *looked_at, measured})
        for first, stop in pairwise(edges):
            judge.add(first, scan.counts(range(first, stop)))
            if stop in looked_at:
                self._reason = judge.look(stop)

    def begun(self, description: ScanDescription) -> None:
        """Take what is known before the first photon."""
        if self._rule.kind != "time":
            self._thread = threading.Thread(target=self._look, args=(description,), daemon=True)
            self._thread.start()

    def __call__(self, event: Event) -> None:
        """Take an event."""
        match event:
            case StepDone(exposure=exposure):
                if self._began_s is None:
                    self._began_s = time.monotonic() - exposure.live_time_s
                if self._thread is not None:
                    self._line.append(np.array(np.atleast_2d(exposure.counts)))
            case LineDone(steps_done=done) if self._thread is not None and self._line:
                self._send(done - len(self._line), np.stack(self._line))
                self._line = []
            case Ended() if self._thread is not None:
                self._thread = None
                self._lines.put(None)

    def _send(self, first: int, counts: NDArray) -> None:
        if self._lines.qsize() * counts.nbytes > WAITING_BYTES:
            self._give_up("pictures were slower than the scan")
        else:
            self._lines.put((first, counts))

    def _give_up(self, why: str) -> None:
        """Leave the scan to itself; it is told at its end."""
        self.trouble = f"{why}: the scan continued without its rule"
        self._thread = None
        self._lines.put(None)

    def _look(self, description: ScanDescription) -> None:
        """Make pictures until the scan is over."""
        try:
            judge = self._judge or _Judge(self._rule, description)
            while (line := self._lines.get()) is not None:
                first, counts = line
                judge.add(first, counts)
                if first + len(counts) in judge.ends:
                    self._reason = self._reason or judge.look(first + len(counts))
        except Exception as error:  # of no harm to the scan
            self._give_up(f"no picture could be made ({error})")


class _Judge:
    """Holds the pictures of rounds against a rule.

    Parameters
    ----------
    rule
        What is waited for.
    scan
        What is known of the scan.

    Attributes
    ----------
    ends
        Number of positions by the end of each round.
    """

    def __init__(self, rule: Rule, scan: ScanDescription | ScanFile) -> None:
        assert scan.plan is not None
        self._rule, self._channels, self.ends = rule, len(scan.channels), rounds_of(scan.plan)
        ends = tuple(self._channels * end for end in self.ends)
        window = Window(start_s=scan.fade_from_s)
        self._growing = GrowingPicture(Coming(expected(scan), ends, window, scan.instrument_response_s))
        self._before: Picture | None = None

    def add(self, first: int, counts: NDArray) -> None:
        """Take (steps, channels, bins) counts from a step on."""
        self._growing.add(first * self._channels, counts.reshape(-1, counts.shape[-1]))

    def look(self, positions: int) -> str:
        """Make the picture of the round that ends now; return why the rule is met, if it is."""
        picture, before = self._growing.picture(), self._before
        self._before = picture
        if self._rule.kind == "contrast":
            value = picture.surface.contrast_seen()
        else:
            value = likeness(picture.front, before.front) if before else 0.0
        if value < self._rule.value:
            return ""
        return (
            f"{self._rule.kind} {value:.4g} of the {self._rule.value:g} requested, after the round of "
            f"{positions:,} positions"
        )


def expected(description: ScanDescription | ScanFile) -> Capture:
    """Return the capture that a scan will have when it is complete; its histograms are not there yet."""
    laser_m, detector_m = description.laser_m, np.asarray(description.detector_m)
    spots_m = detector_m if detector_m.ndim == 3 else detector_m[None]
    channels = len(description.channels)
    delay_s = np.zeros((len(laser_m), channels))
    if description.delays is not None:
        delay_s = description.delays.delay_s(laser_m[:, None], spots_m)
        delay_s = delay_s + [channel.delay_s for channel in description.channels]
    pairs = len(laser_m) * channels
    nothing = np.broadcast_to(np.uint8(0), (pairs, description.bins))
    return Capture(
        ArrayHistograms(nothing),
        description.bin_width_s,
        description.first_bin_s - delay_s.ravel(),
        np.repeat(laser_m, channels, axis=0),
        spots_m[0] if channels == 1 else np.tile(spots_m[0], (len(laser_m), 1)),
    )
