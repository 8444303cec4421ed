"""What a Katana laser is set to, refused where no model takes it."""

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.errors import LimitError
from drivers.katana.dialects import DIALECTS, Dialect


@dataclass(frozen=True, kw_only=True)
class KatanaSettings:
    """Everything that is set while arming, checked when it is made: no laser is needed to be refused.

    Attributes
    ----------
    power_setpoint
        Power in the laser's own scale, 0 to 10.
    repetition_hz
        Pulses a second.
    trigger
        ``"internal"`` or ``"external"``.

    Raises
    ------
    LimitError
        If no model takes this power, repetition rate and trigger.
    """

    power_setpoint: float
    repetition_hz: float
    trigger: str = "internal"

    def __post_init__(self) -> None:
        self.check(DIALECTS)

    def check(self, models: Sequence[Dialect], device: str = "laser") -> None:
        """Raise `LimitError` unless one of ``models`` takes these settings."""
        objections = [self._objection(model) for model in models]
        if all(objections):
            raise LimitError(
                device,
                f"run at power {self.power_setpoint:g}, {self.repetition_hz:g} Hz, {self.trigger} trigger",
                objections[0],
                "Nothing was sent. Correct the configuration.",
            )

    def _objection(self, model: Dialect) -> str:
        """Return why a model does not take these settings; empty if it does."""
        low, high = model.power_range
        if not low <= self.power_setpoint <= high:
            return f"the power set point {self.power_setpoint:g} is not within {low:g} to {high:g}"
        slowest, fastest = model.repetition_range_hz or (1.0, float("inf"))
        rate = self.repetition_hz
        if not slowest <= rate <= fastest or rate == float("inf"):
            return f"the repetition rate {rate:g} Hz is not within {slowest:g} to {fastest:g} Hz"
        if self.trigger not in model.triggers:
            return f"the trigger {self.trigger!r} is none of {', '.join(model.triggers)}"
        return ""
