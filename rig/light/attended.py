"""A laser without a data interface: a person switches it, and the sync pulses tell what they can.

What the sync pulses prove depends on the laser. Where none come before it is switched on, their rate shows
that it pulses, and their end that it no longer does. Where they come all the time, as from a laser whose beam
is shut off inside, they prove nothing: only the person's word is left, and that is said and recorded.
"""

from collections.abc import Callable
from contextlib import suppress
from math import isclose
from types import TracebackType
from typing import Protocol, Self

from drivers.clock import wait_until
from drivers.errors import DeviceError, RefusedError
from drivers.leaving import leave
from rig.devices.by_hand import BEWARE, NEVER_ASKED, somebody
from rig.errors import LightLostError, RigError
from rig.light.guard import ASKING_LEASE_S
from rig.model.config import RigConfig
from rig.model.devices import Clock, GuardedLaser, Operator, Request, Settings
from rig.model.quantities import show

#: By how much the sync rate may differ from that of the configuration.
SYNC_WITHIN = 0.01

#: Longest wait for the sync rate to agree, or for its end; the instrument renews it every 0.1 s.
SYNC_S = 3.0
LOOK_EVERY_S = 0.2


class TakesWord(GuardedLaser, Protocol):
    """A guarded laser that can be said to be dark."""

    def take_word(self) -> None:
        """Believe a person who has switched off a laser that nobody else can."""
        ...


class Attended:
    """What a person does for a laser without a data interface, whose light a guard has in its hands.

    Parameters
    ----------
    guarded
        The laser behind its guard: the shutter, or what stands for a laser that only a person can switch.
    config
        The rig.
    operator
        The person; None where nobody is there.
    sync_hz
        Asks the timing instrument for the sync rate.
    clock
        The time to wait by.
    """

    def __init__(
        self,
        guarded: TakesWord,
        config: RigConfig,
        operator: Operator | None,
        sync_hz: Callable[[], float],
        clock: Clock,
    ) -> None:
        self._guarded = guarded
        self._rate_hz = config.laser.repetition_hz
        self._name = f"laser ({config.light_place})"
        self._what = f"{config.laser.power_in_words}, {show(self._rate_hz, 'Hz', 4)}"
        self._operator = operator
        self._sync_hz = sync_hz
        self._clock = clock
        self._tells = False
        self._answer = NEVER_ASKED

    @property
    def identity(self) -> str:
        """As it is known."""
        return self._guarded.identity

    def settings(self) -> Settings:
        """Return what is known, the person's answer, and what speaks for it."""
        evidence = (
            "there were sync pulses only with the light"
            if self._tells
            else "none: there were sync pulses before, too"
        )
        return {**self._guarded.settings(), "answer": self._answer, "evidence": evidence}

    def emitting(self) -> bool:
        """Return what is known of the light now."""
        return self._guarded.emitting()

    def beat(self, lease_s: float) -> None:
        """Say that all is well for so long."""
        self._guarded.beat(lease_s)

    def _switch_on(self, words: str, meanwhile: Callable[[], bool]) -> None:
        """Have it switched on, and believe that only if the sync rate agrees.

        Raises
        ------
        RigError
            The person says no, or nobody can answer.
        RefusedError
            The sync rate is not the laser's.
        """
        self._tells = self._sync_hz() <= 0
        wanted = Request("laser", f"{words}: {self._what}", {"emitting": True})
        self._answer = somebody(self._operator, wanted).set_by_hand(wanted, meanwhile)

        def agrees() -> bool:
            meanwhile()
            return isclose(self._sync_hz(), self._rate_hz, rel_tol=SYNC_WITHIN)

        if not wait_until(self._clock, agrees, timeout_s=SYNC_S, every_s=LOOK_EVERY_S):
            raise RefusedError(
                self._name,
                f"pulse at {show(self._rate_hz, 'Hz', 4)}",
                f"the sync rate is {show(self._sync_hz(), 'Hz', 4)}",
                "Check that it is on, laser.repetition, and the sync cable with its level.",
            )


class SwitchedByHand(Attended):
    """A laser that only a person can switch on and off; a context manager that asks for darkness at the end.

    Its guard can shout, and no more.
    """

    _lit = False
    _asked_for_darkness = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._lit and not self._asked_for_darkness:
            leave([self.stop], problem)

    def arm(self) -> None:
        """Have the person say that all is ready for light; still dark.

        Raises
        ------
        RigError
            The person says no, or nobody can answer.
        """
        wanted = Request("laser", f"Make the laser ready, and keep it dark: {self._what}", {})
        somebody(self._operator, wanted).set_by_hand(wanted)
        self._guarded.arm()

    def emit(self) -> None:
        """Have it switched on, and believe that only if the sync rate agrees.

        Raises
        ------
        RigError, RefusedError
            The person says no, nobody can answer, or the sync rate is not the laser's. It was asked to be
            switched off.
        """
        self._lit, self._asked_for_darkness = True, False
        self._guarded.emit()  # the guard has to know before there can be light
        try:
            self._switch_on("Switch the laser's emission ON", self._hold)
        except BaseException as problem:
            leave([self.stop], problem)
            raise

    def stop(self) -> None:
        """Have it switched off; what the sync pulses can tell has to agree. Safe to call at any time.

        Raises
        ------
        RefusedError
            Nobody says that it is off, or its sync pulses go on: it has to be treated as emitting.
        """
        if self._lit:
            if doubt := self._doubt_of_darkness(self._ask_for_darkness()):
                raise RefusedError(self._name, "be dark", doubt, BEWARE)
            self._guarded.take_word()
            self._lit = False
        self._guarded.stop()

    def _ask_for_darkness(self) -> str:
        """Tell the person to switch it off, and wait for the answer; return why there is none."""
        wanted = Request("laser", "Switch the laser OFF, now", {"emitting": False}, urgent=True)
        self._asked_for_darkness = True
        try:
            self._answer = somebody(self._operator, wanted).set_by_hand(wanted, self._hold_until_silent)
        except (RigError, DeviceError) as problem:
            return str(problem)
        except KeyboardInterrupt:
            return "the question was interrupted"
        return ""

    def _doubt_of_darkness(self, unanswered: str) -> str:
        """Return why it may be emitting: pulses that came with the light tell more than a person."""
        if not self._tells:
            return unanswered
        if wait_until(self._clock, self._silent, timeout_s=SYNC_S, every_s=LOOK_EVERY_S):
            return ""
        rate = show(self._sync_hz(), "Hz", 4)
        return f"the timing instrument still counts {rate} of its pulses. {unanswered}".strip()

    def _hold(self) -> bool:
        self._guarded.beat(ASKING_LEASE_S)
        return False

    def _hold_until_silent(self) -> bool:
        """Keep the guard quiet while the person is asked; the end of the pulses is an answer as well."""
        with suppress(LightLostError):  # a guard that shouts already is no reason not to ask
            self._guarded.beat(ASKING_LEASE_S)
        return self._tells and self._silent()

    def _silent(self) -> bool:
        try:
            return self._sync_hz() <= 0
        except DeviceError:
            return False


class BehindItsShutter(Attended):
    """A laser that a person has switched on, behind a shutter that the guard holds; a context manager.

    The person is asked once, while the shutter is closed. The laser goes on when the program has ended.
    """

    def __enter__(self) -> Self:
        self._switch_on("The shutter is closed: switch the laser's emission ON behind it", lambda: False)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._operator is not None:
            self._operator.tell(
                "The laser itself was not switched off: only its shutter blocks the light. "
                "Switch it off by hand when you leave."
            )

    def arm(self) -> None:
        """Make the shutter ready; it stays closed."""
        self._guarded.arm()

    def emit(self) -> None:
        """Open the shutter."""
        self._guarded.emit()

    def stop(self) -> None:
        """Close the shutter."""
        self._guarded.stop()
