"""What a Fast-Gated SPAD is set to, refused where it cannot be."""

from dataclasses import dataclass
from math import isfinite

from drivers.errors import LimitError

#: Gate widths that the published driver sends, at 10 MHz. UNCONFIRMED at other rates.
WIDTHS_S = (10e-9, 98e-9)


@dataclass(frozen=True, kw_only=True)
class MpdSettings:
    """How the detector is set, by the computer and by hand.

    Attributes
    ----------
    gated
        True: sensitive only inside the gate, which follows the trigger input. False: free running.
    gate_width_s
        How long the gate stays open.
    gate_delay_s
        Opening edge of the gate after the laser's pulse, which cables make, or a delayer.
    hold_off_s
        What a person has set in MPD's program: time after a detection during which the detector stays off.
    trigger_hz
        Pulses a second that come to the trigger input.

    Raises
    ------
    LimitError
        The gate cannot be so wide.
    """

    gated: bool = True
    gate_width_s: float = 40e-9
    gate_delay_s: float = 0.0
    hold_off_s: float = 100e-9
    trigger_hz: float = 10e6

    def __post_init__(self) -> None:
        if self.gated:
            checked_width_ps("Fast-Gated SPAD", self.gate_width_s)


def checked_width_ps(name: str, width_s: float) -> int:
    """Return a gate's width in picoseconds, or raise LimitError, which names the device."""
    low_s, high_s = WIDTHS_S
    slack_s = 0.5e-12  # what rounding to picoseconds may add
    if not isfinite(width_s) or not low_s - slack_s <= width_s <= high_s + slack_s:
        raise LimitError(
            name,
            f"open its gate for {width_s * 1e9:g} ns",
            f"its range is {low_s * 1e9:g} to {high_s * 1e9:g} ns",
            "Nothing was sent. Correct detector.gate_width.",
        )
    return round(width_s * 1e12)
