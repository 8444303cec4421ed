"""What a SuperK laser is set to, refused where no such laser takes it."""

from dataclasses import dataclass

from drivers.errors import LimitError

#: The pulse picker's register has two bytes.
MOST_SKIPPED = 65535

#: The rate may differ by this from what was asked for.
RATE_WITHIN = 1e-3


@dataclass(frozen=True, kw_only=True)
class NktSettings:
    """Everything that is set while arming, checked when it is made: no laser is needed to be refused.

    Attributes
    ----------
    level_percent
        Of full power or current, as the laser's mode has it.
    oscillator_hz
        Pulses a second of the laser's oscillator, as its label says: the laser cannot be asked.
    repetition_hz
        Pulses a second that leave the pulse picker.

    Raises
    ------
    LimitError
        If the level is no percentage, or the pulse picker cannot make this rate.
    """

    level_percent: float
    oscillator_hz: float
    repetition_hz: float

    def __post_init__(self) -> None:
        if objection := self._objection():
            raise LimitError(
                "SuperK laser",
                f"run at {self.level_percent:g} %, {self.repetition_hz:g} Hz",
                objection,
                "Nothing was sent. Correct the configuration.",
            )

    @property
    def picked(self) -> int:
        """Every how many pulses of the oscillator one leaves."""
        return round(self.oscillator_hz / self.repetition_hz)

    def _objection(self) -> str:
        """Return why no laser takes these settings; empty if one does."""
        if not 0 <= self.level_percent <= 100:
            return f"the level {self.level_percent:g} % is not within 0 to 100 %"
        oscillator, rate = self.oscillator_hz, self.repetition_hz
        if not 0 < rate <= oscillator * (1 + RATE_WITHIN) < float("inf"):
            return (
                f"the repetition rate {rate:g} Hz is not above 0 and at most the oscillator's "
                f"{oscillator:g} Hz"
            )
        if (
            oscillator > (MOST_SKIPPED + 0.5) * rate
            or abs(oscillator / self.picked - rate) > RATE_WITHIN * rate
        ):
            return f"{oscillator:g} Hz is not a whole multiple of {rate:g} Hz"
        return ""
