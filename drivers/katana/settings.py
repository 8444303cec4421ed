"""What a Katana laser is set to, refused where its model does not take it."""

from dataclasses import dataclass

from drivers.errors import LimitError
from drivers.katana.dialects import KATANA_05, Dialect


@dataclass(frozen=True, kw_only=True)
class KatanaSettings:
    """Everything that is set while arming, checked when it is made: no laser is needed to be refused.

    Attributes
    ----------
    power
        In the model's own unit: 0 to 10 for a Katana 05, watt for a Katana 08HP.
    repetition_hz
        Pulses a second.
    trigger
        A name of the model's trigger sources.
    model
        The laser that is meant; another one is refused when it is found.

    Raises
    ------
    LimitError
        If the model does not take this power, repetition rate and trigger.
    """

    power: float
    repetition_hz: float
    trigger: str = "internal"
    model: Dialect = KATANA_05

    def __post_init__(self) -> None:
        if objection := self._objection():
            raise LimitError(
                self.model.model,
                f"run at power {self.power:g}, {self.repetition_hz:g} Hz, {self.trigger} trigger",
                objection,
                "Nothing was sent. Correct the configuration.",
            )

    def _objection(self) -> str:
        """Return why the model does not take these settings; empty if it does."""
        model = self.model
        low, high = model.power_range
        if not low <= self.power <= high:
            return f"the power {self.power:g} is not within {low:g} to {high:g}"
        slowest, fastest = model.repetition_range_hz
        rate = self.repetition_hz
        if not slowest <= rate <= fastest or rate == float("inf"):
            return f"the repetition rate {rate:g} Hz is not within {slowest:g} to {fastest:g} Hz"
        if self.trigger not in model.triggers:
            return f"the trigger {self.trigger!r} is not one of {', '.join(model.triggers)}"
        return ""
