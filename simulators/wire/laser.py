"""The firmware of a green Katana 05 laser, lighting the bench.

Source: the unit's own help listing in a published driver. Unconfirmed, and so choices made here: the text
around ``(Error 100)``, that an accepted setting is not answered, and which bytes follow the emission status.
"""

import re

from simulators.bench import Bench
from simulators.wire.lines import LineFirmware

HELP = """leg=<0|1>, leg? : emission
ltg=<0|1>, ltg? : trigger source, internal or external
ltlg=<xx.xxx>, ltlg? : external trigger level
ltg_freq=<Hz>, ltg_freq? : repetition rate
lp=<xx.xx>, lp? : power, 0 to 10
lps=<0|1>, lps? : power control, knob or RS232
let=<xx.xx>, let? : SHG temperature set point
lestg : store configuration
"""

_SETTING = re.compile(r"([a-z_]+)=\s*([+-]?\d{1,12}(?:\.\d{0,6})?)\s*")


class KatanaHead(LineFirmware):
    """The laser as bytes in and bytes out.

    Parameters
    ----------
    bench
        Its light is switched and dimmed.
    knob
        Position of the power knob on the front panel, 0 to 10; it rules until the serial line takes over.

    Attributes
    ----------
    garble_answers, drop_answers
        So many of the next answers arrive with a flipped bit, or are lost.
    emission_stuck
        Whether emission no longer follows the commands.
    """

    def __init__(self, bench: Bench, *, knob: float = 0.0) -> None:
        super().__init__(terminator=b"\n", longest=64)
        self.drop_answers = 0
        self.garble_answers = 0
        self.emission_stuck = False
        self._bench = bench
        self._key_on = True
        self._interlock_closed = True
        self._knob = knob
        self._power = 0.0
        self._numbers = {"ltg": 0.0, "ltlg": 0.0, "lps": 0.0, "let": 45.0}
        self._apply_power()

    def turn_knob(self, power: float) -> None:
        """Turn the power knob on the front panel, 0 to 10."""
        self._knob = power
        self._apply_power()

    def turn_key(self, on: bool) -> None:
        """Turn the key switch; turning it off ends emission, turning it on does not begin it."""
        self._key_on = on
        if not on:
            self._bench.change_light(emitting=False)

    def close_interlock(self, closed: bool) -> None:
        """Close or open the interlock; opening it ends emission, closing it does not begin it."""
        self._interlock_closed = closed
        if not closed:
            self._bench.change_light(emitting=False)

    def answer(self, line: bytes) -> bytes:
        """Return the answer to one command."""
        sent = self._obey(line.decode("ascii", "replace").strip()).encode("ascii")
        if sent and self.drop_answers:
            self.drop_answers -= 1
            return b""
        if sent and self.garble_answers:
            self.garble_answers -= 1
            return bytes(byte ^ 0x40 if byte != 0x0A else byte for byte in sent)
        return sent

    def junk(self) -> bytes:
        """Answer what is no command."""
        return b"unknown command, h for help\n"

    def _obey(self, command: str) -> str:
        if command == "h":
            return HELP
        if command == "leg?":
            # The real unit sends more bytes after the status.
            return f"leg status: {int(self._bench.light.emitting)}\n\r\n"
        if command == "lestg":
            return ""
        if command.endswith("?"):
            return self._tell(command[:-1])
        match = _SETTING.fullmatch(command)
        return self._change(match[1], float(match[2])) if match else self.junk().decode("ascii")

    def _tell(self, name: str) -> str:
        if name == "lp":
            return f"lp={10 * self._bench.light.power:.2f}\n"
        if name == "ltg_freq":
            return f"ltg_freq={self._bench.light.repetition_hz:.0f}\n"
        if name in self._numbers:
            return f"{name}={self._numbers[name]:g}\n"
        return self.junk().decode("ascii")

    def _change(self, name: str, value: float) -> str:
        if name == "leg" and value in (0, 1):
            return self._switch(bool(value))
        if name == "lp" and 0 <= value <= 10:
            self._power = round(value, 2)
            self._apply_power()
        elif name == "ltg_freq" and 1 <= value <= 1e9:
            self._bench.change_light(repetition_hz=value)
        elif name in ("ltg", "lps") and value in (0, 1):
            self._numbers[name] = value
            self._apply_power()
        elif name in ("ltlg", "let"):
            self._numbers[name] = value
        else:
            return "value not possible (Error 1)\n"
        return ""

    def _switch(self, on: bool) -> str:
        if self.emission_stuck:
            return ""
        if on and not self._key_on:
            return "emission not possible, key switch is off (Error 100)\n"
        # An open interlock is not told: the light just does not come.
        self._bench.change_light(emitting=on and self._interlock_closed)
        return ""

    def _apply_power(self) -> None:
        power = self._power if self._numbers["lps"] else self._knob
        self._bench.change_light(power=power / 10)
