"""What one detection does to those after it: the hold-off, the first photon of a gate, afterpulses."""

from dataclasses import dataclass
from math import exp, expm1

import numpy as np
from numba import njit

from simulators.bench import LightState
from simulators.detector.gate import gates

#: Events that are sorted together, so few that they stay in a processor's cache meanwhile.
RUN = 4096


@dataclass(frozen=True)
class Afterpulsing:
    """Carriers trapped in an avalanche, which set off another when they are released.

    Attributes
    ----------
    probability
        That an avalanche leaves a carrier behind (0.02; 0.01 to 0.03, unconfirmed). 0 is off.
    decay_s
        Mean time until it is released [s] (40 ns; 30 to 50 ns, unconfirmed). What is released while the
        detector is held off, or the gate closed, is lost.
    """

    probability: float = 0.0
    decay_s: float = 40e-9

    def after(self, hold_off_s: float) -> float:
        """Return the probability that a carrier outlasts the hold-off."""
        return self.probability * exp(-hold_off_s / self.decay_s)


@njit(cache=True, error_model="numpy", nogil=True)
def in_order(times, moments, pulses, period):  # type: ignore[no-untyped-def]
    """Give each time after sync its sync pulse out of ``pulses``, and sort by arrival.

    Events are shared out to runs that are even in pulses, and each run is sorted.

    Parameters
    ----------
    times, moments
        (n,) times [s], and which pulse each follows, as parts of the whole time; about evenly spread.
    pulses, period
        How many sync pulses there are, and the time between two [s].

    Returns
    -------
    tuple of ndarray
        (n,) pulses and (n,) times after them [s].
    """
    runs = len(times) // RUN + 1
    pulse, time, ends = _shared_out(times, moments, pulses, runs)
    longest = ends[0]
    for run in range(1, runs):
        longest = max(longest, ends[run] - ends[run - 1])
    room = np.empty(longest, np.int64), np.empty(longest), np.empty(longest + 2, np.int64)
    begin, long = 0, pulses / runs
    for run in range(runs):
        _sort(pulse, time, (begin, ends[run]), (run * long, long), period, room)
        begin = ends[run]
    return pulse, time


@njit(cache=True, error_model="numpy", nogil=True)
def _shared_out(times, moments, pulses, runs):  # type: ignore[no-untyped-def]
    """Return pulse and time of each event, run by run, and where each run ends."""
    count = len(times)
    pulse, time, ends = np.empty(count, np.int64), np.empty(count), np.zeros(runs + 1, np.int64)
    if runs == 1:
        for i in range(count):
            pulse[i], time[i] = int(moments[i] * pulses), times[i]
        ends[0] = count
        return pulse, time, ends
    per_pulse = runs / pulses
    for i in range(count):
        ends[int(int(moments[i] * pulses) * per_pulse) + 1] += 1
    for run in range(runs):
        ends[run + 1] += ends[run]
    for i in range(count):
        drawn = int(moments[i] * pulses)
        run = int(drawn * per_pulse)
        pulse[ends[run]], time[ends[run]] = drawn, times[i]
        ends[run] += 1
    return pulse, time, ends


@njit(cache=True, error_model="numpy", nogil=True)
def _sort(pulse, time, span, pulses, period, room):  # type: ignore[no-untyped-def]
    """Sort a run by as many buckets as it has events, and by insertion as they are put back.

    Late times of the run before, beyond their period, may come after early ones of this: those change places.
    """
    (begin, end), (first, long), (in_pulse, in_time, place) = span, pulses, room
    count = end - begin
    place[: count + 2] = 0
    scale = count / long
    for i in range(begin, end):
        place[min(int((pulse[i] - first) * scale), count - 1) + 2] += 1
    for bucket in range(1, count + 2):
        place[bucket] += place[bucket - 1]
    for i in range(begin, end):
        bucket = min(int((pulse[i] - first) * scale), count - 1) + 1
        in_pulse[place[bucket]], in_time[place[bucket]] = pulse[i], time[i]
        place[bucket] += 1
    for i in range(count):
        p, t, j = in_pulse[i], in_time[i], begin + i
        while j > 0 and (pulse[j - 1] - p) * period + time[j - 1] > t:
            pulse[j], time[j] = pulse[j - 1], time[j - 1]
            j -= 1
        pulse[j], time[j] = p, t


@njit(cache=True, error_model="numpy", nogil=True)
def fold(pulse, time, period):  # type: ignore[no-untyped-def]
    """Count times (n,) beyond a period [s] from a later pulse, negative ones from one before, in place."""
    for i in range(len(time)):
        if not 0.0 <= time[i] < period:
            later = np.floor(time[i] / period)
            pulse[i] += int(later)
            time[i] -= later * period


def detected_hz(seen_hz: float, light: LightState, *, holds_off: bool, afterpulsing: Afterpulsing) -> float:
    """Return how many of ``seen_hz`` detectable events a second are detected, afterpulses included.

    Gated, with a mean of m events a gate, 1 - exp(-m) of the gates that open have a detection (Coates 1968),
    and each of these keeps the next s gates closed: f p / (1 + s p). s is that of events spread evenly over
    the gate, and afterpulses are left out: too few outlast the closed gates. Free running: r / (1 + r h).
    """
    hold_s, period_s = light.hold_off_s, 1 / light.repetition_hz
    if not gates(light):
        rate_hz = seen_hz / (1 - afterpulsing.after(hold_s if holds_off else 0.0))
        return rate_hz / (1 + rate_hz * hold_s) if holds_off else rate_hz
    if not holds_off:
        return seen_hz
    lit = -expm1(-seen_hz * period_s)
    skipped = np.floor((np.linspace(0, light.gate_width_s, 101) + hold_s) / period_s).mean()
    return float(lit / period_s / (1 + skipped * lit))


@njit(cache=True, error_model="numpy", nogil=True)
def avalanches(pulse, time, period, dead, afterpulses, rng):  # type: ignore[no-untyped-def]
    """Keep what is detected of events, which are in order of arrival, and add afterpulses.

    After a detection the detector is off for a while. A gate that begins to open meanwhile stays
    closed (so that at 10 MHz a hold-off of 100 ns costs exactly the next gate; that a gate is not opened late
    is unconfirmed), so there is at most one detection in a gate. Free running, the dead time is not extended
    by what falls into it.

    Parameters
    ----------
    pulse, time
        (n,) each: photons and dark counts that a ready detector would detect, in order, times in s.
    period
        Time between sync pulses [s].
    dead
        How long the detector is off after a detection; when the gate begins to open after the sync pulse,
        and how long it is until it is closed [s]. A negative first: it is ready again at once. A negative
        last: there is no gate.
    afterpulses
        Probability, and mean time to release [s], see `Afterpulsing`.

    Returns
    -------
    tuple of ndarray
        Pulse and time of what is detected, in room that grows with chains of afterpulses.
    """
    if len(pulse) == 0:
        return pulse, time
    size = len(pulse) + 16
    kept_pulse, kept_time = np.empty(size, np.int64), np.empty(size)
    late_pulse, late_time = np.empty(16, np.int64), np.empty(16)
    state = (0, 0, 0, pulse[0] - 1, -1e9 * period)  # next event; kept; pending; when the detector is ready
    while True:
        state = _go_on(
            (pulse, time),
            (kept_pulse, kept_time),
            (late_pulse, late_time),
            state,
            period,
            dead,
            afterpulses,
            rng,
        )
        _, kept, late, _, _ = state
        if kept == len(kept_pulse):
            kept_pulse, kept_time = np.append(kept_pulse, kept_pulse), np.append(kept_time, kept_time)
        elif late == len(late_pulse):
            late_pulse, late_time = np.append(late_pulse, late_pulse), np.append(late_time, late_time)
        else:
            return kept_pulse[:kept], kept_time[:kept]


@njit(cache=True, error_model="numpy", nogil=True)
def _go_on(events, detected, pending, state, period, dead, afterpulses, rng):  # type: ignore[no-untyped-def]
    """Merge events and pending afterpulses by time, until all are through or there is no more room.

    Absolute times stay split in pulse and time, so that a
    long exposure costs no resolution. An event far from the gate that is detected all the same needs only
    the detector to be ready. Pending ones are ordered, the next one last.
    """
    (pulse, time), (kept_pulse, kept_time), (late_pulse, late_time) = events, detected, pending
    i, kept, late, ready_pulse, ready_time = state
    (hold, opening, width), (probability, decay) = dead, afterpulses
    per_s = 1.0 / period
    while (i < len(pulse) or late > 0) and kept < len(kept_pulse) and late < len(late_pulse):
        own = late == 0
        if not own and i < len(pulse):
            own = (pulse[i] - late_pulse[late - 1]) * period + time[i] <= late_time[late - 1]
        if own:
            p, t = pulse[i], time[i]
            i += 1
        else:
            late -= 1
            p, t = late_pulse[late], late_time[late]
        since = (p - ready_pulse) * period + t - ready_time  # since the detector is ready
        if width >= 0.0:
            into = t - opening
            into -= np.floor(into * per_s) * period  # % takes five times as long
            if into <= width:  # its gate must have begun to open after that
                since -= into
            elif not own:
                continue  # released while the gate is closed
        if hold >= 0.0 and since < 0.0:
            continue
        kept_pulse[kept], kept_time[kept] = p, t
        kept += 1
        if hold >= 0.0:
            ready_pulse, ready_time = p, t + hold
        if probability > 0.0 and rng.random() < probability:
            release = rng.exponential() * decay
            if release >= hold:
                j = late  # into its place among the pending ones
                while j > 0 and (late_pulse[j - 1] - p) * period + late_time[j - 1] <= t + release:
                    late_pulse[j], late_time[j] = late_pulse[j - 1], late_time[j - 1]
                    j -= 1
                late_pulse[j], late_time[j] = p, t + release
                late += 1
    return i, kept, late, ready_pulse, ready_time
