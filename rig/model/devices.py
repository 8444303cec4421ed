"""What the application asks of its devices, stated by the consumer.

The classes in `drivers` satisfy these protocols without knowing them. Each device is a context manager that
identifies itself on entry and is left safe on exit: the laser dark, the gate closed, the mirror at rest.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Clock(Protocol):
    """Something that tells time and can wait."""

    def now_s(self) -> float:
        """Return a monotonic time in seconds."""
        ...

    def sleep(self, duration_s: float) -> None:
        """Wait for ``duration_s`` seconds of this clock."""
        ...


#: Names and values of a device's settings.
Settings = Mapping[str, str | int | float | bool]


class Device(Protocol):
    """What all devices share."""

    @property
    def identity(self) -> str:
        """Maker, model, serial number and firmware as the device reports them."""
        ...

    def settings(self) -> Settings:
        """Return the settings as read back from the device, or as last accepted where it has no read-back."""
        ...


class Galvo(Device, Protocol):
    """A two-axis beam-steering mirror."""

    def point(self, angle_x_rad: float, angle_y_rad: float) -> None:
        """Steer the beam to these optical angles (right and up, facing the wall), without waiting."""
        ...

    def wait_settled(self, timeout_s: float) -> None:
        """Return when the mirror is stable; raise if it is not after ``timeout_s``."""
        ...


class SweepingGalvo(Galvo, Protocol):
    """A mirror that can go through many positions by itself, one at each tick of a point clock."""

    @property
    def longest_trajectory(self) -> int:
        """How many positions `trajectory` takes at most."""
        ...

    def loading_s(self, positions: int) -> float:
        """Estimate how long `trajectory` takes with so many positions."""
        ...

    def trajectory(
        self, angles_rad: NDArray[np.float64], tick_s: float, meanwhile: Callable[[], None]
    ) -> None:
        """Load positions that the mirror takes one after the other, one at each tick of the point clock.

        It goes to the first at once, and stays at the last; `point` ends it at any time.

        Parameters
        ----------
        angles_rad
            (n, 2) optical angles, as of `point`; all are checked before anything is sent.
        tick_s
            Time between two ticks.
        meanwhile
            Called many times a second while they are sent, which may take seconds; it may raise.
        """
        ...


class PointClock(Device, Protocol):
    """The source of the pulses that step the mirror and mark the points in the timing instrument's records.

    It ticks evenly. At each tick a pulse steps the mirror, and one goes to each marker input that is asked
    for. It is at rest when opened, and left at rest.
    """

    def load(self, marks: NDArray[np.uint8], tick_s: float) -> None:
        """Load what is marked.

        Parameters
        ----------
        marks
            (n,) marker inputs of each tick, a bit each: M1 is 1, M2 is 2, M3 is 4, M4 is 8; 0 marks nothing.
        tick_s
            Time between two ticks.
        """
        ...

    def start(self) -> None:
        """Begin with the first tick, now."""
        ...

    def running(self) -> bool:
        """Return whether ticks are still to come."""
        ...

    def stop(self) -> None:
        """End the ticks; safe to call at any time."""
        ...


class Laser(Device, Protocol):
    """A pulsed laser. Emission takes two steps, and never begins on connect."""

    def arm(self) -> None:
        """Take control and set the power; still dark."""
        ...

    def emit(self) -> None:
        """Begin emission; raise unless armed, and unless the read-back confirms it."""
        ...

    def stop(self) -> None:
        """End emission and disarm; safe to call at any time."""
        ...

    def emitting(self) -> bool:
        """Return what the laser itself says about its emission, asked now; dark only by two answers."""
        ...


class GuardedLaser(Laser, Protocol):
    """A laser whose light is held by a guard, and lasts only while the guard hears that all is well."""

    def beat(self, lease_s: float) -> None:
        """Say that all is well; the light goes out unless that is said again within ``lease_s``.

        Raises `rig.errors.LightLostError` if the guard has put the light out, or found it out.
        """
        ...


class Shutter(Device, Protocol):
    """A shutter in the laser's beam; closed when opened as a device, and left closed."""

    def let_through(self) -> None:
        """Open it; return when it is open."""
        ...

    def close(self) -> None:
        """Close it; return when it is closed. Safe to call at any time."""
        ...

    def is_open(self) -> bool:
        """Return whether it is open: read back where it can be, else as it was told last."""
        ...


class GatedSpad(Device, Protocol):
    """A single-photon detector with a gate locked to the laser's pulses."""

    @property
    def by_hand(self) -> frozenset[str]:
        """What only a person can set: of "bias", "hold_off", "gate_delay" and "gate_width".

        At most it is read back. A detector whose bias is set by hand stays biased after `disable`.
        """
        ...

    def enable(self) -> None:
        """Bias the detector and open the configured gate on every pulse."""
        ...

    def disable(self) -> None:
        """Remove the bias; safe to call at any time."""
        ...

    def set_gate(self, delay_s: float, width_s: float) -> None:
        """Move the gate: opening edge after the sync pulse, and how long it stays open."""
        ...

    def set_hold_off(self, hold_off_s: float) -> None:
        """Set the time after a detection during which the detector stays off."""
        ...


class GateDelayer(Device, Protocol):
    """A delay generator between the laser's sync pulse and the detector's gate."""

    def set_delay(self, delay_s: float) -> None:
        """Set the time from the pulse that comes to the pulse that goes; verified."""
        ...

    def enable(self) -> None:
        """Let pulses out; verified."""
        ...

    def disable(self) -> None:
        """Let no pulse out; safe to call at any time."""
        ...


class Exposure(Protocol):
    """What one timed measurement gave."""

    @property
    def counts(self) -> NDArray[np.uint32]:
        """(channels, bins) photons a bin; valid until the next measurement."""
        ...

    @property
    def photons(self) -> int:
        """Sum of all counts."""
        ...

    @property
    def live_time_s(self) -> float:
        """Measurement time that the instrument reports."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """Plain sentences about this measurement, e.g. overflow or a lost sync; empty when all is well."""
        ...

    @property
    def whole(self) -> bool:
        """Whether it lasted as long as was asked for."""
        ...


class Rates(Protocol):
    """Count rates as the timing instrument measures them, in counts a second."""

    @property
    def sync_hz(self) -> float:
        """Sync pulses a second."""
        ...

    @property
    def input_hz(self) -> float:
        """Detections a second."""
        ...


class TimingInstrument(Device, Protocol):
    """A time-correlated single-photon counter: it times photons from the sync pulse before them."""

    @property
    def bins(self) -> int:
        """Number of bins of a histogram."""
        ...

    @property
    def bin_width_s(self) -> float:
        """The bin width that the instrument really uses."""
        ...

    @property
    def first_bin_s(self) -> float:
        """Left edge of the first bin of a histogram, after the sync pulse."""
        ...

    def rates(self) -> Rates:
        """Return sync and input count rates."""
        ...

    def warnings(self) -> tuple[str, ...]:
        """Return what the instrument itself warns about, as plain sentences."""
        ...


class Tcspc(TimingInstrument, Protocol):
    """A timing instrument that makes histograms itself."""

    def measure(self, exposure_s: float, meanwhile: Callable[[], bool]) -> Exposure:
        """Clear, expose for ``exposure_s``, and return the histogram.

        ``meanwhile`` is called ten times a second while an exposure lasts; it ends at once when that returns
        True, and is left in order when that raises.
        """
        ...


class Records(Protocol):
    """What a time-tagged instrument recorded since the records before: photons and markers in order of time.

    All of it is valid until the next is taken.
    """

    @property
    def words(self) -> NDArray[np.uint32]:
        """(n,) records as the instrument gives them."""
        ...

    @property
    def batch(self) -> "TaggedBatch":
        """The same, decoded."""
        ...

    @property
    def complete_to(self) -> int:
        """What comes later has this tag or a higher one."""
        ...

    @property
    def faults(self) -> tuple[str, ...]:
        """What went wrong near these records, as plain sentences, e.g. a lost sync."""
        ...


class TaggedBatch(Protocol):
    """Photons and markers with their times."""

    @property
    def tag(self) -> NDArray[np.int64]:
        """(photons,) sync pulse before each photon, counted from the start."""
        ...

    @property
    def dtime(self) -> NDArray[np.uint16]:
        """(photons,) time bin after that pulse."""
        ...

    @property
    def channel(self) -> NDArray[np.int8]:
        """(photons,) input of the instrument."""
        ...

    @property
    def marker_tag(self) -> NDArray[np.int64]:
        """(markers,) sync pulse before each marker."""
        ...

    @property
    def marker_mask(self) -> NDArray[np.uint8]:
        """(markers,) which inputs were marked, a bit each."""
        ...

    @property
    def marker_photon(self) -> NDArray[np.int64]:
        """(markers,) how many photons of the batch lie before each marker."""
        ...


class TimeTagger(TimingInstrument, Protocol):
    """A timing instrument that records each photon and each marker by itself.

    Its rates and warnings can be asked for while it records. A photon beyond its bins is in no histogram.
    """

    def start(self, duration_s: float | None = None) -> None:
        """Begin to record, for a time or until `stop`."""
        ...

    def records(self) -> Iterator[Records]:
        """Yield what is recorded as it comes, and at least ten times a second something, until the end."""
        ...

    def stop(self) -> None:
        """End the recording; what was recorded until now can still be taken."""
        ...


class Preparation(Enum):
    """What is asked of the person at the rig; `words` says it in full."""

    MEASURE = "measure"
    ATTENUATE = "attenuate"
    BLOCK = "block"
    COVER = "cover"
    LAMP = "lamp"

    @property
    def words(self) -> str:
        """What is to be done, as a sentence."""
        return _WORDS[self]


_WORDS = {
    Preparation.MEASURE: "Remove filter, beam stop and cover, and switch the lamp off: "
    "the rig is then as for a scan",
    Preparation.ATTENUATE: "Remove beam stop and cover, and put the filter (optical density 1 or more) "
    "into the beam",
    Preparation.BLOCK: "Remove filter and cover, and put the beam stop in front of the laser; its sync "
    "pulses go on",
    Preparation.COVER: "Put the beam stop in front of the laser, and cover the detector's lens",
    Preparation.LAMP: "Put the beam stop in front of the laser, uncover the lens, and light the wall with a "
    "steady lamp",
}


@dataclass(frozen=True)
class Board:
    """A flat checkerboard, by which cameras are calibrated.

    Its first inner corner is the one whose square between columns and rows is black: one of the two numbers
    of corners is odd and the other even, so that there is only one such corner. Seen from the front, columns
    run to the right of it and rows upwards.

    Attributes
    ----------
    columns, rows
        Inner corners along either side.
    square_m
        Side of a square [m].
    """

    columns: int = 9
    rows: int = 6
    square_m: float = 0.08


@dataclass(frozen=True)
class Request:
    """Something that only a person can set, because the device has no interface for it.

    Attributes
    ----------
    device
        Its role in the configuration.
    words
        What is to be done, as an order.
    settings
        The same by names and SI values.
    urgent
        Whether it has to be done now: light that no program can put out.
    """

    device: str
    words: str
    settings: Settings
    urgent: bool = False


class Operator(Protocol):
    """The person at the rig, or the bench in their place."""

    def set_by_hand(self, wanted: Request, meanwhile: Callable[[], bool] = lambda: False) -> str:
        """Have something set by hand; return who says that it is so, and when.

        ``meanwhile`` is called several times a second; where it returns True the question is no longer
        needed. Raises `rig.errors.RigError` if the person says no, or nobody can answer.
        """
        ...

    def tell(self, words: str) -> None:
        """Tell the person something that must not be missed."""
        ...

    def prepare(self, preparation: Preparation) -> None:
        """Return when the rig is prepared so, and only so."""
        ...

    def aim_at(
        self, galvo: Galvo, mark_m: tuple[float, float], meanwhile: Callable[[], None]
    ) -> tuple[float, float]:
        """Steer the beam onto a mark (x, y) on the wall, and return the commanded optical angles.

        ``meanwhile`` is called several times a second: it keeps the beam on, or raises.
        """
        ...

    def show_board(self, board: Board, mark_m: tuple[float, float] | None) -> None:
        """Hold a checkerboard still before the cameras, until the next thing that is asked.

        Flat on the wall, its first inner corner on the mark (x, y) and its columns along the wall's x; or,
        where there is no mark, freely, and another way each time.
        """
        ...


class WallCamera(Protocol):
    """A camera that sees the relay wall."""

    @property
    def name(self) -> str:
        """Which camera it is."""
        ...

    @property
    def full(self) -> int:
        """Count at which a pixel is full."""
        ...

    def image(self) -> NDArray[np.uint16]:
        """Return a picture taken now, (height, width), grey."""
        ...
