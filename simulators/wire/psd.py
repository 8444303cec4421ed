"""The firmware of an MPD Picosecond Delayer, which triggers the gate of the bench's detector.

Source: two published drivers. UNCONFIRMED, and so choices made here: which pulse widths there are between 1
and 250 ns (steps of 3 and 4 ns in turn; published is "3 or 4 ns"), that ``EO`` answers the state in effect,
that what the echo sends is the command and ``#``, and that a unit in local mode still answers questions.
"""

import re
from itertools import accumulate, cycle, takewhile

from simulators.bench import Bench
from simulators.wire.lines import LineFirmware

#: Widths that a pulse can have [ns].
WIDTHS_NS = (*takewhile(lambda width: width < 250, accumulate(cycle((3, 4)), initial=1)), 250)
FINE_STEP_PS, LONGEST_PS = 10, 49_090

_SETTING = re.compile(r"(EM|EO|SH|SV|SP|SD|SE|HS)(-?[0-9]{1,9})")

#: What is set: lowest and highest value, and the errors of what is below and above.
_RANGES = {
    "SH": (-2000, 2000, 6, 5),
    "SV": (1, 999, 4, 3),
    "SP": (1, 250, 10, 9),
    "SD": (0, LONGEST_PS, 8, 7),
    "EO": (0, 1, 1, 1),
    "EM": (0, 1, 1, 1),
    "SE": (0, 1, 1, 1),
    "HS": (0, 1, 1, 1),
}
_ASKED = {"RD": "SD", "RP": "SP", "RH": "SH", "RE": "SE", "RO": "EO"}


class PsdFirmware(LineFirmware):
    """A delayer as bytes in and bytes out; it begins with its echo on, and with its output off.

    Parameters
    ----------
    bench
        Its gate is triggered and delayed.

    Attributes
    ----------
    local
        Whether only its front panel sets it.
    output_stuck
        Whether its output no longer follows the commands.
    drop_answers
        So many of the next answers are lost.
    """

    def __init__(self, bench: Bench) -> None:
        super().__init__(terminator=b"#", longest=64)
        self.local = False
        self.output_stuck = False
        self.drop_answers = 0
        self._bench = bench
        self._set = {"EM": 1, "EO": 0, "SH": 0, "SV": 1, "SP": WIDTHS_NS[0], "SD": 0, "SE": 1, "HS": 0}
        self._act()

    def answer(self, line: bytes) -> bytes:
        """Return the answer to one command."""
        command = line.decode("ascii", "replace").strip()
        echo = f"{command}#".encode("ascii", "replace") if self._set["EM"] else b""
        said = echo + f"{self._obey(command)}#".encode("ascii")
        if self.drop_answers:
            self.drop_answers -= 1
            return b""
        return said

    def junk(self) -> bytes:
        """Answer what is no command."""
        return b"ERR1#"

    def _obey(self, command: str) -> str:
        if command == "RT":
            return "55"
        if command == "RMD":
            return str(LONGEST_PS)
        if command in _ASKED:
            return str(self._set[_ASKED[command]])
        match = _SETTING.fullmatch(command)
        return self._change(match[1], int(match[2])) if match else "ERR1"

    def _change(self, name: str, value: int) -> str:
        low, high, below, above = _RANGES[name]
        if self.local and name != "EM":
            return "ERR2"
        if not low <= value <= high:
            return f"ERR{below if value < low else above}"
        if name == "SP":
            value = min(WIDTHS_NS, key=lambda width: abs(width - value))
        elif name in ("SD", "SH"):
            value = round(value / 10) * 10
        if name != "EO" or not self.output_stuck:
            self._set[name] = value
        self._act()
        return str(self._set[name])

    def _act(self) -> None:
        """Bring the bench's gate to the state of the settings."""
        delay_s = (1000 * self._set["SP"] + self._set["SD"]) / 1e12
        triggered, every, light = bool(self._set["EO"]), self._set["SV"], self._bench.light
        if (light.gate_delay_s, light.triggered, light.gate_every) != (delay_s, triggered, every):
            self._bench.change_light(gate_delay_s=delay_s, triggered=triggered, gate_every=every)
