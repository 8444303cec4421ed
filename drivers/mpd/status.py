"""What a Fast-Gated SPAD says of itself: pieces of a name and a number, each ended by ``#``.

Source: one published driver, in use (gSTED-sFCS): the names, and the linear fits, which are of that author's
module and are another one's only about. UNCONFIRMED: that other firmware spells them so, what ``SE`` means,
and the order of the pieces, which is not used.
"""

import re
from dataclasses import dataclass

#: Everything that ``AQ`` and ``DC`` are answered with.
NAMES = ("VPOL", "FR", "ERR", "VT", "SE", "TS", "GF", "TO", "TK", "HO", "CT", "CE", "CC")

#: Without these nothing is known of the detector.
NEEDED = ("VPOL", "FR", "ERR", "GF", "TO", "HO")

#: One step of the hold-off [s], and the hold-off at code 0.
HOLD_OFF_STEP_S, HOLD_OFF_LEAST_S = 3e-9, 18e-9

_PIECE = re.compile(r"([A-Z]{2,4})(-?[0-9]{1,10})")


@dataclass(frozen=True)
class Status:
    """The state of the detector.

    Attributes
    ----------
    codes
        The numbers as they came, by their names.
    """

    codes: dict[str, int]

    @property
    def biased(self) -> bool:
        """Whether the bias is on."""
        return self.codes["VPOL"] != 0

    @property
    def free_running(self) -> bool:
        """Whether it is sensitive all the time."""
        return self.codes["FR"] == 1

    @property
    def error(self) -> int:
        """Number of what is wrong; 0 is nothing."""
        return self.codes["ERR"]

    @property
    def gate_hz(self) -> float:
        """Gates a second, as measured."""
        return float(self.codes["GF"])

    @property
    def gate_width_s(self) -> float:
        """How long the gate stays open."""
        return self.codes["TO"] / 1e12

    @property
    def hold_off_s(self) -> float:
        """The hold-off, by the fit of another module."""
        return self.codes["HO"] * HOLD_OFF_STEP_S + HOLD_OFF_LEAST_S

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return all of it, in SI units where the unit is known."""
        codes = self.codes
        known: dict[str, str | int | float | bool] = {
            "biased": self.biased,
            "gated": not self.free_running,
            "error": self.error,
            "gate_rate_hz": self.gate_hz,
            "gate_width_s": self.gate_width_s,
        }
        fits = {
            "trigger_level_v": ("VT", 1e-3, 0.0),
            "temperature_c": ("TK", 0.1, -273.0),
            "avalanche_threshold_v": ("CT", -2e-3, 0.4),
            "excess_bias_v": ("CE", -0.0241, 6.97),
            "current_limit_a": ("CC", -0.4545e-3, 0.11545),
        }
        known |= {
            name: codes[code] * scale + at_zero
            for name, (code, scale, at_zero) in fits.items()
            if code in codes
        }
        return known | {f"code_{name.lower()}": codes[name] for name in ("SE", "TS", "HO") if name in codes}


def parse_piece(text: str) -> tuple[str, int] | None:
    """Return name and number of a piece; None where it is none that is known."""
    match = _PIECE.fullmatch(text.strip())
    return (match[1], int(match[2])) if match and match[1] in NAMES else None
