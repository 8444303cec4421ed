"""The optical bench: mirror, laser, gate, hidden scene and one clock, as physical state.

The simulated devices change this state or are driven by it; photons follow from it and from nothing else.
"""

import struct
from bisect import bisect_left, insort
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from math import ceil, inf, radians, tan
from operator import attrgetter
from threading import RLock
from typing import Protocol, TypeGuard, runtime_checkable

import numpy as np
from numpy.random import PCG64, Generator
from numpy.typing import NDArray

from simulators.clock import BenchClock
from simulators.motion.mirror import SteeringMirror
from simulators.motion.mount import MirrorMount
from simulators.ticks import Ticks
from simulators.track import STEP_S, Track

#: A moving mirror is followed in pieces of at most so much bench time [s], so that memory is bounded.
MOVEMENT_S = 10e-3

#: Tangent in which mirror positions are counted, in single precision, where photons are drawn for them. Any
#: will do; this one has been used from the beginning, and another one would draw other photons.
SEED_TANGENT = tan(radians(50.0))

#: Largest block that is freed before the first exposure [bytes]. The GNU C library gives blocks above a
#: threshold back to the system at once, and each page of the next exposure's arrays is then a page fault.
#: The threshold rises to the largest block freed so far, but not above 32 MiB (mallopt(3), M_MMAP_THRESHOLD);
#: twice as much stays with the program. A dense position (1 s, 157 000 photons) takes 12.3 ms of processor
#: time so, and 16.0 ms without it; the most memory that is in use is the same. Other C libraries do not mind.
KEPT_BYTES = 31 << 20

#: How long a pulse at a marker input is if nobody says otherwise [s].
MARK_S = 10e-6

Spot = tuple[float, float, float]


@dataclass(frozen=True)
class Channel:
    """One pixel of the detector, from the spot it looks at to the input that counts it.

    Attributes
    ----------
    spot_m
        The spot on the wall that it looks at [m].
    input
        The input of the timing instrument that its cable leads to, counted from 0.
    delay_s
        What it takes from detection to that input more than `BenchGeometry.electronics_delay_s` says [s].
    """

    spot_m: Spot = (0.0, 0.0, 0.0)
    input: int = 0
    delay_s: float = 0.0


@dataclass(frozen=True)
class BenchGeometry:
    """Where things stand, in the wall's frame [m], and how long the electronics take.

    Attributes
    ----------
    galvo_m
        The mirror, from which the beam leaves.
    detector_head_m
        The detector's lens, which all channels share.
    channels
        The detector's channels; a single detector is a list of one.
    electronics_delay_s
        From the sync pulse to light leaving the mirror, plus from detection to the timing input.
    mount
        How the mirror stands there, and how it obeys.

    Raises
    ------
    ValueError
        If two channels are at the same input.
    """

    galvo_m: Spot = (-0.2, 0.0, 2.5)
    detector_head_m: Spot = (0.2, 0.0, 2.5)
    channels: tuple[Channel, ...] = (Channel(),)
    electronics_delay_s: float = 12.3e-9
    mount: MirrorMount = field(default_factory=MirrorMount)

    def __post_init__(self) -> None:
        inputs = [channel.input for channel in self.channels]
        if len(set(inputs)) < len(inputs):
            raise ValueError(f"each detector channel needs an input of its own, not {inputs}")

    def laser_spot_m(self, mirror_rad: tuple[float, float]) -> Spot:
        """Return where the beam meets the wall z = 0 when the mirror is commanded to these optical angles.

        Raises
        ------
        ValueError
            If the beam goes away from the wall.
        """
        start_m, direction = self.mount.ray(mirror_rad)
        x_m, y_m, z_m = (a + b for a, b in zip(start_m.tolist(), self.galvo_m, strict=True))
        along_x, along_y, along_z = direction.tolist()
        if not along_z < 0:
            raise ValueError(f"the mirror at {mirror_rad} rad sends the beam away from the wall")
        return x_m - along_x * (z_m / along_z), y_m - along_y * (z_m / along_z), 0.0

    def laser_spots_m(self, mirror_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return `laser_spot_m` (n, 3) of (n, 2) angles.

        Raises
        ------
        ValueError
            If the beam goes away from the wall.
        """
        starts_m, directions = self.mount.rays(mirror_rad)
        starts_m = starts_m + self.galvo_m
        if not (directions[:, 2] < 0).all():
            raise ValueError("the moving mirror sends the beam away from the wall")
        spots_m = starts_m - directions * (starts_m[:, 2:] / directions[:, 2:])
        spots_m[:, 2] = 0.0
        return np.asarray(spots_m)


@dataclass(frozen=True)
class LightState:
    """Everything but the mirror that decides which photons are detected.

    Attributes
    ----------
    emitting
        Whether light leaves the laser.
    power
        Fraction of full power, 0 to 1.
    repetition_hz
        Pulses a second.
    biased
        Whether the detector has its bias.
    triggered
        Whether anything opens the gate; without it a gated detector detects nothing.
    gated
        True: sensitive only inside the gate. False: free running.
    gate_delay_s, gate_width_s
        When the gate is half open after the sync pulse, at the detector; the time until it is half closed.
    gate_every
        The gate opens for the first of so many sync pulses.
    hold_off_s
        Time after a detection during which the detector stays off.
    attenuation
        What filters in the beam let pass.
    blocked
        Whether a beam stop keeps the light from the wall; the laser's sync pulses go on.
    shuttered
        Whether a shutter keeps the light in; the laser's sync pulses go on.
    covered
        Whether the detector's lens is covered.
    lamp_hz
        Counts a second, while sensitive, of a steady lamp that shines on the wall.
    """

    emitting: bool = False
    power: float = 1.0
    repetition_hz: float = 10e6
    biased: bool = False
    triggered: bool = True
    gated: bool = False
    gate_delay_s: float = 0.0
    gate_width_s: float = 40e-9
    gate_every: int = 1
    hold_off_s: float = 100e-9
    attenuation: float = 1.0
    blocked: bool = False
    shuttered: bool = False
    covered: bool = False
    lamp_hz: float = 0.0

    @property
    def sync_hz(self) -> float:
        """Sync pulses a second; the laser gives them only while it emits."""
        return self.repetition_hz if self.emitting else 0.0

    @property
    def of_open_gates(self) -> "LightState":
        """The same with only those pulses for which the gate opens; what the others send is not seen.

        A gate that opens periods later is as good as one that opens for a later pulse.
        """
        if not self.gated or self.gate_every == 1:
            return self
        return replace(
            self,
            power=self.power / self.gate_every,
            repetition_hz=self.repetition_hz / self.gate_every,
            gate_delay_s=self.gate_delay_s % (1 / self.repetition_hz),
            gate_every=1,
        )

    @property
    def sensitive(self) -> bool:
        """Whether the detector can detect at all."""
        return self.biased and (self.triggered or not self.gated)

    @property
    def on_wall(self) -> float:
        """Fraction of the laser's full power that reaches the wall."""
        stopped = self.blocked or self.shuttered
        return self.power * self.attenuation if self.emitting and not stopped else 0.0

    @property
    def received(self) -> float:
        """Fraction of the laser's full power by which the detector's lens gets its light."""
        return 0.0 if self.covered else self.on_wall


@dataclass(frozen=True)
class Detections:
    """Detections in order of arrival, as the timing input gets them.

    Attributes
    ----------
    pulse
        (n,) int64, the sync pulse that each follows, counted from the beginning of the exposure.
    time_s
        (n,) time after that pulse [s].
    """

    pulse: NDArray[np.int64]
    time_s: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.pulse)


@dataclass(frozen=True)
class Syncs:
    """A time in which sync pulses come evenly, or none at all.

    Attributes
    ----------
    begin_s, end_s
        Bench times.
    hz
        Sync pulses a second; the first comes at ``begin_s``.
    """

    begin_s: float
    end_s: float
    hz: float


@dataclass(frozen=True)
class Mark:
    """A pulse at the marker inputs of the timing instrument.

    Attributes
    ----------
    at_s, width_s
        Bench time of its rising edge; time until it falls.
    mask
        A bit for each of the four inputs that it comes to.
    """

    at_s: float
    mask: int
    width_s: float


def no_detections() -> Detections:
    """Return an empty record."""
    return Detections(np.empty(0, np.int64), np.empty(0))


class Photons(Protocol):
    """The physics of what one channel detects while nothing changes."""

    def detections(
        self, laser_spot_m: Spot, light: LightState, duration_s: float, rng: np.random.Generator
    ) -> Detections:
        """Draw the detections of ``duration_s``, times after sync folded into one period."""
        ...

    def detections_along(self, track: Track, light: LightState, rng: np.random.Generator) -> Detections:
        """Draw the detections while the laser spot goes its way, times after sync folded into one period."""
        ...

    def rate_hz(self, laser_spot_m: Spot, light: LightState) -> float:
        """Return the expected detections a second."""
        ...


@runtime_checkable
class MovingPhotons(Photons, Protocol):
    """The same of a scene that moves meanwhile."""

    def at(self, bench_s: float) -> Photons:
        """Return what is detected from a bench time on, the scene where it is then."""
        ...


def moves(photons: Photons) -> TypeGuard[MovingPhotons]:
    """Return whether photons are those of a scene that moves; it is asked at each exposure."""
    return _kind_moves(type(photons))


@cache
def _kind_moves(kind: type) -> bool:
    return issubclass(kind, MovingPhotons)  # all methods of a protocol are looked for, which takes long


@dataclass(frozen=True)
class _Stretch:
    """A time in which only mirror and scene move: where the laser points, since when, how long.

    `first_pulse` counts sync pulses.
    """

    spot_m: Spot | Track
    light: LightState
    begin_s: float
    duration_s: float
    first_pulse: int

    def drawn(self, photons: Photons, rng: np.random.Generator) -> Detections:
        """Draw what a channel detects."""
        light = self.light.of_open_gates
        if isinstance(self.spot_m, Track):
            found = photons.detections_along(self.spot_m, light, rng)
        else:
            found = photons.detections(self.spot_m, light, self.duration_s, rng)
        if light is self.light:
            return found
        # each is timed from the pulse before it, whether a gate opened for that one or not
        later = np.floor(found.time_s * self.light.repetition_hz)
        pulse = found.pulse * self.light.gate_every + later.astype(np.int64)
        return Detections(pulse, found.time_s - later / self.light.repetition_hz)


def _drawn(
    photons: Photons, delay_s: float, stretches: Sequence[_Stretch], rng: np.random.Generator
) -> Detections:
    """Draw a channel's detections of all stretches, as they arrive at the end of its cable."""
    pieces = []
    for one in stretches:
        piece = one.drawn(photons.at(one.begin_s) if moves(photons) else photons, rng)
        pieces.append(Detections(piece.pulse + one.first_pulse, piece.time_s + delay_s))
    if len(pieces) == 1:
        return pieces[0]
    pieces.append(no_detections())  # for a time without length
    return Detections(
        np.concatenate([piece.pulse for piece in pieces]), np.concatenate([piece.time_s for piece in pieces])
    )


def _parts(duration_s: float, longest_s: float) -> int:
    """Return into how many parts a time is cut; rounding makes none more."""
    return max(ceil(duration_s / longest_s - 1e-6), 1)


def _words(numbers: Sequence[int]) -> NDArray[np.uint32]:
    """Return the words of 32 bits of all numbers, the lowest first: what numpy makes of them, only sooner."""
    return np.array(
        [n >> low & 0xFFFFFFFF for n in numbers for low in range(0, max(n.bit_length(), 1), 32)], np.uint32
    )


class Bench:
    """The physical state behind all simulated devices.

    Photon statistics are drawn from the seed, the commanded mirror position, how often that position has been
    measured, and the channel, so that a resumed scan equals an uninterrupted one and no two channels share a
    draw. A bench whose clock does not begin at zero, in place of one that has drawn already, draws others.

    Several threads may use it: one may draw photons while another commands mirror and switches.

    Parameters
    ----------
    photons
        The physics of detection of each of the geometry's channels; none where nobody asks for photons.
    geometry
        Where mirror, detector and detector spots are.
    seed
        Seed of all photon statistics.
    clock
        The one clock; by default it runs as fast as the computer can.
    mirror
        By default one that is as quick as the rig's.

    Attributes
    ----------
    watchers
        Called with the bench time [s] after each change of light or mirror.
    tick_listeners
        Called with the (n,) bench times [s] of all ticks of a point clock when these begin.
    stop_listeners
        Called with the bench time [s] from which on no more ticks come, when they are ended early.

    Raises
    ------
    ValueError
        If there are photons of more or fewer channels than the geometry has.
    """

    def __init__(
        self,
        photons: Sequence[Photons] = (),
        geometry: BenchGeometry | None = None,
        *,
        seed: int = 0,
        clock: BenchClock | None = None,
        mirror: SteeringMirror | None = None,
    ) -> None:
        self.geometry = geometry or BenchGeometry()
        if photons and len(photons) != len(self.geometry.channels):
            raise ValueError(
                f"photons of {len(photons)} channels for a detector of {len(self.geometry.channels)}"
            )
        self.photons = tuple(photons)
        self._began_s = clock.now_s() if clock else 0.0
        self.seed = seed
        self.clock = clock or BenchClock()
        self.mirror = mirror or SteeringMirror()
        self.watchers: list[Callable[[float], None]] = []
        self.tick_listeners: list[Callable[[NDArray[np.float64]], None]] = []
        self.stop_listeners: list[Callable[[float], None]] = []
        self._light = [(0.0, LightState())]
        self._visits: dict[tuple[float, float], int] = {}
        self._marks: list[Mark] = []
        self._ticks: Ticks | None = None
        self._rates: dict[int, tuple[tuple[tuple[float, float], LightState], float]] = {}
        self._lock = RLock()  # of all that is above; not held while photons are drawn or others are told

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The detector's channels."""
        return self.geometry.channels

    @property
    def light(self) -> LightState:
        """The state in force now."""
        with self._lock:
            return self._light[-1][1]

    @property
    def target_rad(self) -> tuple[float, float]:
        """Optical angles that the mirror is commanded to now [rad]."""
        with self._lock:
            return self.mirror.target(self.clock.now_s())

    @property
    def position_rad(self) -> tuple[float, float]:
        """Optical angles of the mirror now [rad]."""
        with self._lock:
            return self.mirror.position(self.clock.now_s())

    @property
    def settled(self) -> bool:
        """Whether the mirror stands where it is commanded to now."""
        with self._lock:
            return self.mirror.settled(self.clock.now_s())

    @property
    def known_from_s(self) -> float:
        """The earliest time whose light and mirror are known."""
        with self._lock:
            return max(self._light[0][0], self.mirror.known_from_s)

    @property
    def ticks_end_s(self) -> float:
        """Bench time of the last tick that was started [s]; 0 before any."""
        with self._lock:
            return self._ticks.end_s if self._ticks else 0.0

    def change_light(self, **changes: bool | float) -> None:
        """Change fields of `LightState` from now on."""
        with self._lock:
            now_s = self.clock.now_s()
            self._light.append((now_s, replace(self.light, **changes)))  # type: ignore[arg-type]
        self._tell(now_s)

    def steer(self, x_rad: float, y_rad: float) -> None:
        """Command the mirror to optical angles, from now on; what was commanded for later is dropped."""
        with self._lock:
            now_s = self.clock.now_s()
            self.mirror.command(x_rad, y_rad, now_s)
        self._tell(now_s)

    def follow(self, times_s: NDArray[np.float64], angles_rad: NDArray[np.float64]) -> None:
        """Command the mirror to each pair (n, 2) of optical angles at each of (n,) ascending bench times.

        A later `steer` drops what is still to come.
        """
        with self._lock:
            self.mirror.follow(times_s, angles_rad)

    def stop_following(self, now_s: float) -> None:
        """Drop what the mirror is commanded to after a time."""
        with self._lock:
            self.mirror.drop_after(now_s)

    def start_ticks(self, marks: NDArray[np.uint8], tick_s: float, *, start_s: float | None = None) -> None:
        """Let a point clock tick; ticks of before that are still to come do not come.

        Parameters
        ----------
        marks
            (n,) marker inputs that a pulse comes to with each tick, a bit each; 0 is none.
        tick_s
            Time between two ticks [s].
        start_s
            Bench time of the first; None is now.

        Raises
        ------
        ValueError
            If there is no tick, no time between two, or a mark of another input than the four.
        """
        if self.ticks_end_s > self.clock.now_s():
            self.stop_ticks()
        with self._lock:
            begin_s = self.clock.now_s() if start_s is None else start_s
            ticks = Ticks(np.asarray(marks, np.uint8), tick_s, begin_s)
            self._take_ticked(inf)  # nobody has taken these yet, but somebody may
            self._ticks = ticks
        for listener in self.tick_listeners:
            listener(ticks.times_s)

    def stop_ticks(self) -> None:
        """Let no more ticks come."""
        with self._lock:
            now_s = self.clock.now_s()
            if self._ticks:
                self._ticks.stop(now_s)
        for listener in self.stop_listeners:
            listener(now_s)

    def sync_rate_hz(self) -> float:
        """Sync pulses a second; the laser gives them only while it emits."""
        return self.light.sync_hz

    def count_rate_hz(self, channel: int) -> float:
        """Return the expected detections a second of a channel, by its number, in the present state.

        The last ones are remembered, since a long exposure is looked at many times.
        """
        with self._lock:
            state = self.position_rad, self.light
        known = self._rates.get(channel)
        if known is None or known[0] != state:
            position, light = state
            spot_m = self.geometry.laser_spot_m(position)
            known = self._rates[channel] = state, self.photons[channel].rate_hz(spot_m, light.of_open_gates)
        return known[1]

    def detections(self, start_s: float, stop_s: float) -> tuple[Detections, ...]:
        """Draw what each channel saw between two bench times, the mirror and all switches followed.

        At each change, and each `MOVEMENT_S` of a moving mirror, the detector begins anew, ready.
        """
        return self.drawing(start_s, stop_s)()

    def drawing(self, start_s: float, stop_s: float) -> Callable[[], tuple[Detections, ...]]:
        """Take down all that `detections` follows; return what then draws, at any time and in any thread."""
        with self._lock:
            stretches, generators = self._stretches(start_s, stop_s), self._generators(start_s)
            self.forget_before(start_s)
        channels = tuple(zip(self.photons, self.channels, generators, strict=True))
        return lambda: tuple(
            _drawn(photons, channel.delay_s, stretches, rng) for photons, channel, rng in channels
        )

    def warm_up(self) -> None:
        """Draw a little light and throw it away, so that what has to be compiled is before anybody waits.

        A mirror is moved for the same reason, but not the bench's.
        """
        np.empty(KEPT_BYTES, np.uint8)  # freed at once, and never touched
        moved = SteeringMirror()
        moved.command(0.1, 0.1, 0.0)
        moved.settled(1.0)
        self.geometry.mount.ray((0.1, 0.1))
        way = Track(np.array([(0.3, 0.0, 0.0), (0.31, 0.0, 0.0)]), 1e-3)
        wide_open = LightState(emitting=True, biased=True, gated=True, gate_width_s=90e-9, lamp_hz=1e6)
        for photons in self.photons:
            photons.detections((0.3, 0.0, 0.0), wide_open, 1e-3, np.random.default_rng(0))
            photons.detections_along(way, wide_open, np.random.default_rng(0))

    def syncs_between(self, start_s: float, stop_s: float) -> list[Syncs]:
        """Return how sync pulses came between two bench times, cut where their rate changed."""
        found: list[Syncs] = []
        with self._lock:
            switches = [at for at, _ in self._light if start_s < at < stop_s]
            for begin_s, end_s in pairwise([start_s, *switches, stop_s]):
                hz = self._light_at(begin_s).sync_hz
                if found and found[-1].hz == hz:
                    begin_s = found.pop().begin_s
                found.append(Syncs(begin_s, end_s, hz))
        return found

    def mark(self, mask: int, at_s: float | None = None, *, width_s: float = MARK_S) -> None:
        """Send a pulse to some of the marker inputs, now or at a later time.

        Parameters
        ----------
        mask
            A bit for each of the four inputs: 1, 2, 4, 8, or a sum of these.
        at_s
            Bench time of the rising edge; None is now.
        width_s
            Time until it falls.

        Raises
        ------
        ValueError
            If there are no such inputs.
        """
        if not 0 < mask < 16:
            raise ValueError(f"there are four marker inputs, with a mask of 1 to 15, not {mask}")
        with self._lock:
            at_s = self.clock.now_s() if at_s is None else at_s
            insort(self._marks, Mark(at_s, mask, width_s), key=attrgetter("at_s"))

    def take_marks(self, before_s: float) -> list[Mark]:
        """Take away the pulses at the marker inputs that begin before a time, in order."""
        with self._lock:
            self._take_ticked(before_s)
            number = bisect_left(self._marks, before_s, key=attrgetter("at_s"))
            taken, self._marks = self._marks[:number], self._marks[number:]
        return taken

    def forget_before(self, at_s: float) -> None:
        """Drop what was changed before a time that nobody will ask about again."""
        with self._lock:
            self.take_marks(at_s)
            self.mirror.forget_before(at_s)
            while len(self._light) > 1 and self._light[1][0] <= at_s:
                del self._light[0]

    def _take_ticked(self, before_s: float) -> None:
        """Put the ticks' pulses before a time among the others."""
        if not self._ticks:
            return
        width_s = min(MARK_S, self._ticks.tick_s / 2)
        for at_s, mask in self._ticks.take(before_s):
            insort(self._marks, Mark(at_s, mask, width_s), key=attrgetter("at_s"))

    def _tell(self, now_s: float) -> None:
        for watcher in self.watchers:
            watcher(now_s)

    def _generators(self, start_s: float) -> list[np.random.Generator]:
        """Return the random numbers of each channel for a visit to what the mirror is commanded to then."""
        target = self.mirror.target(start_s)
        visit = self._visits.get(target, 0)
        self._visits[target] = visit + 1
        position = struct.pack("<2f", *(tan(angle) / SEED_TANGENT for angle in target))
        entropy = [self.seed, *struct.unpack("<2I", position), visit]
        if self._began_s:  # visits of before were those of another bench
            entropy.append(round(self._began_s * 1e6))
        first = np.random.SeedSequence(_words(entropy))  # the channels after the first are its children
        return [Generator(PCG64(one)) for one in (first, *first.spawn(len(self.photons) - 1))]

    def _stretches(self, start_s: float, stop_s: float) -> list[_Stretch]:
        """Cut a time into stretches in which no switch changes, and the mirror stands or goes a short way."""
        stretches = []
        switches = [at for at, _ in self._light if start_s < at < stop_s]
        for since_s, until_s in pairwise([start_s, *switches, stop_s]):
            light = self._light_at(since_s)
            for begin_s, end_s, moving in self.mirror.moving_between(since_s, until_s):
                pieces_s = [begin_s, end_s]
                if moving:
                    pieces_s = np.linspace(begin_s, end_s, _parts(end_s - begin_s, MOVEMENT_S) + 1).tolist()
                for piece_s, next_s in pairwise(pieces_s):
                    spot = self._track(piece_s, next_s) if moving else self._spot_m(piece_s)
                    first = round((piece_s - start_s) * light.repetition_hz)
                    stretches.append(_Stretch(spot, light, piece_s, next_s - piece_s, first))
        return stretches

    def _spot_m(self, at_s: float) -> Spot:
        return self.geometry.laser_spot_m(self.mirror.position(at_s))

    def _track(self, begin_s: float, end_s: float) -> Track:
        times_s = np.linspace(begin_s, end_s, _parts(end_s - begin_s, STEP_S) + 1)
        return Track(self.geometry.laser_spots_m(self.mirror.positions(times_s)), end_s - begin_s)

    def _light_at(self, at_s: float) -> LightState:
        return next(light for since, light in reversed(self._light) if since <= at_s)
