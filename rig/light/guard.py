"""The guard of the laser's light, as a machine of states; who runs it is said elsewhere.

::

             arm                emit, and the laser confirms it
    DARK ---------> ARMED ------------------------------------> LIT
     ^  ^             | stop                                     |  stop asked; no word from the
     |  '-------------'                                          |  program in time; the laser dark
     |                                                           |  by itself; switched off by
     |            dark by two fresh answers                      |  somebody
     '-----------------------------------------------------------+
     |                                                           |  it cannot be made dark,
     |            tried again until it is                        v  or cannot be asked
     '-------------------------------------------------------- ALARM

Every way out of LIT goes through the same act: emission off, and two fresh answers that agree. Light never
comes back from DARK or ALARM by itself: `arm` and `emit` have to be asked for anew.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum

from drivers.errors import DeviceError, LinkError, RefusedError
from rig.devices.by_hand import LaserByHand
from rig.model.devices import Clock, Laser, Settings

#: How often a laser that is lit is looked at.
LOOK_S = 0.2

#: For so long the light may stay without a word while a vendor's library is called, which may never return;
#: while mirror and detector are asked, whose lines have time limits; and while files are written.
LIBRARY_LEASE_S = 0.8
ASKING_LEASE_S = 4.0
FILE_LEASE_S = 15.0

#: The longest time for which a program may say that all is well.
LONGEST_LEASE_S = 20.0

#: Why the light of a silent program is put out.
OVERDUE = "the program did not report in time that all is well"


class Light(Enum):
    """What the guard knows of the light."""

    DARK = "dark"
    ARMED = "armed"
    LIT = "lit"
    ALARM = "emitting, or not answering"


@dataclass(frozen=True)
class Lost:
    """The light was put out, or found out, without the program's wish.

    Attributes
    ----------
    reason
        Why, as a sentence.
    dark
        Whether the laser has confirmed that it is dark.
    trip
        Whether a person has to look at the rig before there is light again.
    how
        What speaks for darkness.
    """

    reason: str
    dark: bool
    trip: bool
    how: str = "read back twice"


class Guard:
    """Lights a laser for a program, watches it, and puts it out.

    `turn` is to be called several times in `LOOK_S` while there may be light.

    Parameters
    ----------
    laser
        The laser itself, open.
    clock
        The time to watch by.
    tell
        Called when the light was lost, and again when a laser that could not be made dark is dark at last.
    known_dark_by
        What speaks for darkness, in words.
    """

    def __init__(
        self,
        laser: Laser,
        clock: Clock,
        tell: Callable[[Lost], None],
        known_dark_by: str = "read back twice",
    ) -> None:
        self._laser = laser
        self._clock = clock
        self._tell = tell
        self._known_dark_by = known_dark_by
        self.light = Light.DARK
        self._until_s = 0.0
        self._looked_s = 0.0
        self._alarm = "the laser could not be made dark"
        self._within_reach = True

    def arm(self) -> None:
        """Prepare the laser; still dark.

        Raises
        ------
        DeviceError
            As the laser does.
        """
        self._not_in_alarm("arm")
        self._laser.arm()
        self.light = Light.ARMED

    def emit(self, lease_s: float) -> None:
        """Light the laser for so long, until it is said again that all is well.

        The time counts from when the laser emits: the laser takes its time to light, the program does not.

        Raises
        ------
        DeviceError
            As the laser does; it was told to stay dark.
        """
        self._not_in_alarm("emit")
        try:
            self._laser.emit()
        except BaseException:
            if problem := self._put_out():
                self._in_alarm(str(problem))
            raise
        self.light = Light.LIT
        self._looked_s = self._clock.now_s()
        self.hold(self._looked_s + lease_s)

    def hold(self, until_s: float) -> None:
        """Take it that all is well until a time of the clock."""
        self._until_s = min(self._clock.now_s() + LONGEST_LEASE_S, until_s)  # NaN gives the first

    def emitting(self) -> bool:
        """Ask the laser now; light that is gone is lost.

        Raises
        ------
        DeviceError
            As the laser does.
        """
        emitting = self._laser.emitting()
        self._looked_s = self._clock.now_s()
        if self.light is Light.LIT and not emitting:
            self._gone()
        return emitting

    def stop(self) -> None:
        """Put the light out, because it is no longer wanted.

        Raises
        ------
        DeviceError
            If the laser does not confirm that it is dark; the guard goes on trying.
        """
        if problem := self._put_out():
            self._in_alarm(str(problem))
            raise problem

    def take_word(self) -> None:
        """Believe a person who has switched off a laser that nobody else can; after an alarm it is told.

        Raises
        ------
        RefusedError
            If the laser can be asked itself.
        """
        if not isinstance(self._laser, LaserByHand):
            raise RefusedError("laser", "count as dark", "it can report its own state", "Ask the laser.")
        self._laser.take_word()
        if self.light is Light.ALARM:
            self._try_again(at_once=True)
        else:
            self.light = Light.DARK

    @property
    def overdue(self) -> bool:
        """Whether there is light, and a word of the program should have come by now."""
        return self.light is Light.LIT and self._clock.now_s() > self._until_s

    @property
    def opens_anew(self) -> bool:
        """Whether opening the laser's line anew can put it out."""
        return not isinstance(self._laser, LaserByHand)

    def settings(self) -> Settings:
        """Return what the laser says of itself."""
        return self._laser.settings()

    def lose(self, reason: str, *, trip: bool) -> None:
        """Put the light out without the program's wish, and tell it."""
        if problem := self._put_out():
            self._in_alarm(f"{reason}. {problem}")
        else:
            self._tell(Lost(reason, True, trip, self._known_dark_by))

    def turn(self) -> None:
        """Look whether anything has to be done, and do it."""
        if self.light is Light.ALARM:
            self._try_again()
        elif self.light is Light.LIT:
            if self.overdue:
                self.lose(OVERDUE, trip=False)
            elif self._clock.now_s() - self._looked_s >= LOOK_S:
                self._look()

    def let_go(self) -> None:
        """Know nothing of the laser until `take`: its line is closed, and a closed laser takes any order."""
        self._within_reach = False

    def take(self, laser: Laser) -> None:
        """Go on with a laser that was opened anew, which has put it out."""
        self._laser, self._within_reach = laser, True
        self._try_again(at_once=True)

    def _look(self) -> None:
        try:
            self.emitting()
        except DeviceError as first:
            try:  # a garbled answer is no reason to end a scan
                self.emitting()
            except DeviceError:
                self.lose(f"the laser could not be asked whether it emits ({first.answered})", trip=False)

    def _in_alarm(self, reason: str) -> None:
        """Tell of a laser that may be emitting, and keep why."""
        self._alarm = reason
        self._tell(Lost(reason, False, True))

    def _gone(self) -> None:
        self.lose(
            "the laser went dark without a command: check interlock and key, "
            "and that nobody is in the path of the beam",
            trip=True,
        )

    def _try_again(self, *, at_once: bool = False) -> None:
        now_s = self._clock.now_s()
        if now_s - self._looked_s < LOOK_S and not at_once:
            return
        self._looked_s = now_s
        if self._put_out() is None:
            self._tell(Lost(f"{self._alarm}. It is dark now", True, True, self._known_dark_by))

    def _put_out(self) -> DeviceError | None:
        """Make the laser dark; return why that is not confirmed, if it is not."""
        self.light = Light.ALARM  # until it is known better
        self._until_s = 0.0
        try:
            self._require_line()
            self._laser.stop()
        except DeviceError as problem:
            self._looked_s = self._clock.now_s()
            return problem
        except BaseException:
            with suppress(DeviceError):  # an interrupt does not end this
                self._laser.stop()
                self.light = Light.DARK
            raise
        self.light = Light.DARK
        return None

    def _require_line(self) -> None:
        if not self._within_reach:
            raise LinkError(
                "laser",
                "be dark",
                "its line cannot be opened any more",
                "Treat the laser as EMITTING: turn its key off by hand, and check its cable.",
            )

    def _not_in_alarm(self, asked: str) -> None:
        if self.light is Light.ALARM:
            raise RefusedError(
                "laser",
                asked,
                "it could not be made dark, or could not be asked",
                "Treat the laser as EMITTING: turn its key off by hand, and find out why.",
            )
