"""A laser whose guard runs in the same process: enough for a simulated one, which ends with the program."""

from rig.errors import LightLostError
from rig.light.guard import Guard, Lost
from rig.model.devices import Clock, Laser, Settings


class GuardedHere:
    """A laser with its guard beside it; the guard looks whenever the program says that all is well.

    It hears that before it judges: where the program is silent, as on a computer that stands still, the guard
    stands still, too.

    Parameters
    ----------
    laser
        The laser, open.
    clock
        The time to watch by.
    """

    def __init__(self, laser: Laser, clock: Clock) -> None:
        self._laser = laser
        self._clock = clock
        self._lost: list[Lost] = []
        self._guard = Guard(laser, clock, self._lost.append)

    @property
    def identity(self) -> str:
        """As the laser reports it."""
        return self._laser.identity

    def settings(self) -> Settings:
        """Return the settings as read back."""
        return self._guard.settings()

    def arm(self) -> None:
        """Prepare the laser; still dark."""
        self._lost.clear()
        self._guard.arm()

    def emit(self) -> None:
        """Light the laser."""
        self._guard.emit(FIRST_LEASE_S)

    def stop(self) -> None:
        """Put the light out."""
        self._guard.stop()

    def take_word(self) -> None:
        """Believe a person who has switched off a laser that nobody else can."""
        self._guard.take_word()

    def emitting(self) -> bool:
        """Ask the laser now."""
        return self._guard.emitting()

    def beat(self, lease_s: float) -> None:
        """Say that all is well for so long, and let the guard look.

        Raises
        ------
        LightLostError
            If the light is lost.
        """
        self._guard.hold(self._clock.now_s() + lease_s)
        self._guard.turn()
        raise_lost(self._lost)


#: What is said of a laser that cannot be made dark.
BEWARE = "Treat the laser as EMITTING: turn its key off by hand, now"

#: For so long light is granted when it comes.
FIRST_LEASE_S = 1.0


def raise_lost(lost: list[Lost]) -> None:
    """Raise what the guard has told, if it has.

    Raises
    ------
    LightLostError
        If the light is lost.
    """
    if lost:
        raise LightLostError(in_words(lost[-1]))


def in_words(lost: Lost) -> str:
    """Return what was lost and why, and what is known of the light now."""
    reason = lost.reason.removesuffix(".")
    return f"{reason}. {f'The laser is dark, {lost.how}' if lost.dark else BEWARE}."
