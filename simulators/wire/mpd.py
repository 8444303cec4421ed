"""The firmware of an MPD Fast-Gated SPAD, gating the bench's detector.

Bias and hold-off are set by hand, on the bench itself: `Bench.change_light`. The firmware only tells them.

Source: one published driver. UNCONFIRMED, and so choices made here: which names ``AQ`` and which ``DC`` are
answered with, that settings take effect with ``AD``, what they are answered (``answers_settings``), what an
unknown command is answered (nothing), and the gate's rate where no trigger comes (0). The fits are those of
that driver.
"""

import re

from simulators.bench import Bench
from simulators.wire.lines import LineFirmware

#: Gate widths [ps] that it takes; others are limited to these.
WIDTHS_PS = (10_000, 98_000)

_SETTING = re.compile(r"(TO|TS)([0-9]{1,9})|(FR|GM)")


class MpdModule(LineFirmware):
    """The detector as bytes in and bytes out; it begins gated, as it was left.

    Parameters
    ----------
    bench
        Its detector is gated.
    biased, hold_off_s, error
        What a person had set before, and the number of what is wrong; 0 is nothing.
    gate_delay_s
        What the trigger cable makes; None where a delayer does.

    Attributes
    ----------
    answers_settings
        Whether the choice of a mode is answered, as that of a width is.
    gate_stuck
        Whether the gate no longer follows the commands.
    gate_hz
        The rate that it measures at its trigger input; None is that of the pulses which come.
    drop_answers
        So many of the next answers are lost.
    """

    def __init__(
        self,
        bench: Bench,
        *,
        biased: bool = True,
        hold_off_s: float = 100e-9,
        error: int = 0,
        gate_delay_s: float | None = None,
    ) -> None:
        super().__init__(terminator=b"#", longest=128)
        self.error = error
        self.answers_settings = True
        self.gate_stuck = False
        self.gate_hz: float | None = None
        self.drop_answers = 0
        self._bench = bench
        self._wanted = {"FR": 0, "TO": 40_000, "TS": 0}
        self._set = dict(self._wanted)
        delay_s = bench.light.gate_delay_s if gate_delay_s is None else gate_delay_s
        bench.change_light(biased=biased, hold_off_s=hold_off_s, gate_delay_s=delay_s)
        self._act()

    def _act(self) -> None:
        """Bring the bench's gate to the state of the settings."""
        light = self._bench.light
        state: dict[str, bool | float] = {
            "gated": not self._set["FR"],
            "gate_width_s": self._set["TO"] / 1e12,
        }
        changed = {name: value for name, value in state.items() if getattr(light, name) != value}
        if changed:
            self._bench.change_light(**changed)

    def answer(self, line: bytes) -> bytes:
        """Return the answer to one line of commands."""
        said = "".join(f"{piece}#" for one in line.split(b";") for piece in self._obey(one))
        if said and self.drop_answers:
            self.drop_answers -= 1
            return b""
        return said.encode("ascii")

    def junk(self) -> bytes:
        """Answer nothing to what is no command."""
        return b""

    def _obey(self, one: bytes) -> list[str]:
        command = one.decode("ascii", "replace").strip()
        if command == "AQ":
            return self._state()
        if command == "DC":
            return self._codes()
        if command == "AD":
            if not self.gate_stuck:
                self._set = dict(self._wanted)
            self._act()
        elif match := _SETTING.fullmatch(command):
            return self._want(match)
        return []

    def _want(self, match: re.Match[str]) -> list[str]:
        if match[3]:
            self._wanted["FR"] = int(match[3] == "FR")
            return []
        value = int(match[2])
        if match[1] == "TS":
            self._wanted["TS"] = value
            return [f"TS{value}"] if self.answers_settings else []
        low, high = WIDTHS_PS
        self._wanted["TO"] = min(max(value, low), high)
        return [f"TO{self._wanted['TO']}"]

    def _state(self) -> list[str]:
        now, light = self._set, self._bench.light
        rate_hz = light.sync_hz / light.gate_every if light.triggered else 0.0
        rate_hz = rate_hz if self.gate_hz is None else self.gate_hz
        return [
            f"VPOL{int(light.biased)}", f"FR{now['FR']}", f"ERR{self.error}", "VT100", "SE1",
            f"TS{now['TS']}", f"GF{rate_hz:.0f}", f"TO{now['TO']}", "TK2530",
        ]  # fmt: skip

    def _codes(self) -> list[str]:
        """Return the codes of what is set by hand."""
        hold_off = max(round((self._bench.light.hold_off_s * 1e9 - 18) / 3), 0)
        return [f"HO{hold_off}", "CT150", "CE82", "CC228"]
