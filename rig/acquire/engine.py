"""The scan engine: a loop over a plan that speaks to devices and tells what happens as events."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from enum import Enum

from rig.errors import RefusedError
from rig.model.devices import Clock, Device, Exposure, Galvo, GatedSpad, Laser, Rates, Settings, Tcspc
from rig.model.plan import ScanPlan
from rig.model.pointing import Pointing

#: Wait after emission begins before count rates are read: the instrument renews them every 100 ms, and the
#: vendor's demos (HHLib 3.0) wait 400 ms after a change.
RATE_SETTLING_S = 0.4

#: How often the laser is asked whether it still emits: its interlock shows in nothing else.
WATCH_INTERVAL_S = 1.0


class Phase(Enum):
    """What the engine is doing.

    ::

        AIMING -> LIGHTING -> CHECKING -> EXPOSING -> CLOSING
    """

    AIMING = "aiming"
    LIGHTING = "lighting"
    CHECKING = "checking rates"
    EXPOSING = "exposing"
    CLOSING = "closing"


class Outcome(Enum):
    """How a scan ended."""

    COMPLETE = "complete"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


@dataclass(frozen=True)
class PhaseChanged:
    """The engine began another phase."""

    phase: Phase


@dataclass(frozen=True)
class Ready:
    """All is set for the first exposure.

    Attributes
    ----------
    rates
        Sync and count rates.
    warnings
        The timing instrument's own warnings.
    settings
        What each device says of itself and its settings now, by device name.
    """

    rates: Rates
    warnings: tuple[str, ...]
    settings: dict[str, Settings]


@dataclass(frozen=True)
class PositionDone:
    """One position was measured. ``exposure.counts`` is valid only while the event is handled."""

    index: int
    exposure: Exposure


@dataclass(frozen=True)
class LineDone:
    """All positions of a line were measured: a good moment to put data on disk."""

    positions_done: int


@dataclass(frozen=True)
class Ended:
    """The scan is over and the laser is dark.

    Attributes
    ----------
    outcome, reason
        How and why.
    positions_done
        Positions that can be trusted; fewer than were measured where the laser went dark unnoticed.
    """

    outcome: Outcome
    positions_done: int
    reason: str


Event = PhaseChanged | Ready | PositionDone | LineDone | Ended
Consumer = Callable[[Event], None]


@dataclass(frozen=True)
class Devices:
    """The devices of a scan and the clock that they share, opened and identified."""

    galvo: Galvo
    laser: Laser
    spad: GatedSpad
    tcspc: Tcspc
    clock: Clock

    def identities(self) -> dict[str, str]:
        """Return the identity of each device."""
        return {name: device.identity for name, device in self._named.items()}

    def read_back(self) -> dict[str, Settings]:
        """Return identity and settings of each device as they are now."""
        return {
            name: {"identity": device.identity, **device.settings()} for name, device in self._named.items()
        }

    @property
    def _named(self) -> dict[str, Device]:
        return {"galvo": self.galvo, "laser": self.laser, "spad": self.spad, "tcspc": self.tcspc}


class ScanEngine:
    """Runs a plan. Its only output is events; files and displays are consumers of these.

    Parameters
    ----------
    devices
        Opened devices.
    plan
        What to measure.
    pointing
        From wall spots to mirror angles.
    settle_timeout_s
        Longest wait for the mirror at each position.
    first
        Position to begin with; those before it were measured earlier.
    """

    def __init__(
        self,
        devices: Devices,
        plan: ScanPlan,
        pointing: Pointing,
        *,
        settle_timeout_s: float,
        first: int = 0,
    ) -> None:
        self._devices = devices
        self._plan = plan
        self._angles_rad = pointing.angles_rad(plan.spots_m)
        self._settle_timeout_s = settle_timeout_s
        self._done = first

    def run(self, consume: Consumer, should_stop: Callable[[], bool]) -> Ended:
        """Measure all positions, or stop after the one at which ``should_stop`` becomes true.

        The laser is dark and the detector unbiased when this returns or raises.

        Raises
        ------
        drivers.errors.DeviceError
            If a device fails; an `Ended` event with the outcome FAILED came before.
        RefusedError
            If no sync pulses arrive, or the laser goes dark by itself.
        """
        outcome, reason = Outcome.FAILED, "a device failed"
        try:
            self._light_up(consume)
            consume(PhaseChanged(Phase.EXPOSING))
            self._expose_all(consume, should_stop)
            if self._done == self._plan.positions:
                outcome, reason = Outcome.COMPLETE, "all positions measured"
            else:
                outcome, reason = Outcome.INTERRUPTED, "stopped by the operator"
        except KeyboardInterrupt:
            outcome, reason = Outcome.INTERRUPTED, "stopped at once by the operator"
            raise
        except Exception as error:
            reason = str(error)
            raise
        finally:
            with ExitStack() as last:  # every step is tried, whatever fails before it
                ended = Ended(outcome, self._done, reason)
                last.callback(consume, ended)
                last.callback(self._devices.spad.disable)
                last.callback(self._devices.laser.stop)
                last.callback(consume, PhaseChanged(Phase.CLOSING))
        return ended

    def _light_up(self, consume: Consumer) -> None:
        devices = self._devices
        consume(PhaseChanged(Phase.AIMING))
        self._aim(self._done)  # the beam is inside the plan before there is a beam
        consume(PhaseChanged(Phase.LIGHTING))
        devices.laser.arm()
        devices.laser.emit()
        devices.spad.enable()
        consume(PhaseChanged(Phase.CHECKING))
        devices.clock.sleep(RATE_SETTLING_S)
        rates = devices.tcspc.rates()
        if rates.sync_hz <= 0:
            raise RefusedError(
                "the timing instrument sees no sync pulses although the laser says that it emits. "
                "Check the sync cable and hydraharp.sync_level, then scan again"
            )
        consume(Ready(rates, devices.tcspc.warnings(), devices.read_back()))

    def _expose_all(self, consume: Consumer, should_stop: Callable[[], bool]) -> None:
        lines = self._plan.line_of_position
        seen_s, seen_at = self._devices.clock.now_s(), self._done
        while self._done < len(lines) and not should_stop():
            index = self._done
            self._aim(index)
            if self._devices.clock.now_s() - seen_s > WATCH_INTERVAL_S:
                self._require_light(seen_at)
                seen_s, seen_at = self._devices.clock.now_s(), index
            consume(PositionDone(index, self._devices.tcspc.measure(self._plan.exposure_s)))
            self._done += 1
            if self._done == len(lines) or lines[self._done] != lines[index]:
                consume(LineDone(self._done))
        self._require_light(seen_at)  # the positions since the last look, too

    def _require_light(self, seen_at: int) -> None:
        """Raise if the laser went dark by itself, and tell since which position the data is in doubt."""
        if not self._devices.laser.emitting():
            measured, self._done = self._done, seen_at
            raise RefusedError(
                "the laser went dark by itself: check interlock and key. It was last seen emitting at "
                f"position {seen_at}; positions {seen_at} to {measured - 1} may be dark and are taken back: "
                "mend it and resume the scan"
            )

    def _aim(self, index: int) -> None:
        self._devices.galvo.point(*self._angles_rad[index])
        self._devices.galvo.wait_settled(self._settle_timeout_s)
