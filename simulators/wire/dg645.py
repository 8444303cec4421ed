"""The firmware of a Stanford Research Systems DG645 delay generator, triggering the bench's gate.

Source: the command list of its manual and its error numbers, as published drivers quote them. UNCONFIRMED,
and so choices made here: with how many digits numbers are told, and that a setting out of range is error 10.
Output AB gates the detector.
"""

import re
from collections.abc import Callable
from math import inf

from simulators.bench import Bench
from simulators.wire.delayer import DelayerFirmware

#: Smallest and largest value of the settings that have no index.
PLAIN = {"TSRC": (0, 6), "TLVL": (-3.5, 3.5), "ADVT": (0, 1), "BURM": (0, 1), "INHB": (0, 5)}
#: The same of those of the outputs T0, AB, CD, EF and GH, and where they begin.
OF_OUTPUT = {
    "LAMP": (0.5, 5.0, 2.5),
    "LOFF": (-3.0, 3.0, 0.0),
    "LPOL": (0, 1, 1),
    "PRES": (1, 2**30 - 1, 1),  # of the trigger input in place of T0
}
VOLTS = ("TLVL", "LAMP", "LOFF")

LONGEST_S = 2000.0
STEP_S = 5e-12
INSERTION_S = 85e-9

ILLEGAL_VALUE, ILLEGAL_DELAY, ILLEGAL_LINK, UNDEFINED, MISSING, SYNTAX = 10, 12, 13, 111, 116, 126
MOST_ERRORS = 20

_COMMAND = re.compile(r"(\*?[A-Z]{3,4})(\?)?\s*(.*)")


class Dg645Box(DelayerFirmware):
    """A DG645 as bytes in and bytes out.

    Parameters
    ----------
    bench
        Its gate follows channel A.
    """

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench, insertion_delay_s=INSERTION_S, terminator=b"\n", longest=256)
        self._plain: dict[str, float] = dict.fromkeys(PLAIN, 0.0)
        self._of_output = {name: [start] * 5 for name, (_, _, start) in OF_OUTPUT.items()}
        self._delays = dict.fromkeys(range(2, 10), (0, 0.0))
        self._errors: list[int] = []
        self._act()

    def junk(self) -> bytes:
        """Remember what is no command as an error; it is not answered."""
        return self._wrong(SYNTAX)

    def obey(self, line: bytes) -> bytes:
        """Do what a line says, and return its answer; only questions have one."""
        told = _COMMAND.fullmatch(line.decode("ascii", "replace").strip().upper())
        if told is None:
            return self._wrong(SYNTAX) if line.strip() else b""
        name, asked, rest = told.groups()
        parameters = [one.strip() for one in rest.split(",")] if rest.strip() else []
        answer = self._tell(name, parameters) if asked else self._change(name, parameters)
        self._act()
        return answer

    def _tell(self, name: str, parameters: list[str]) -> bytes:
        fixed: dict[str, Callable[[], str]] = {
            "*IDN": lambda: "Stanford Research Systems,DG645,s/n001776,ver1.14.10E",
            "LERR": lambda: str(self._errors.pop() if self._errors else 0),
        }
        if name in fixed:
            return fixed[name]().encode() + b"\r\n"
        if name in self._plain:
            return self._told(name, self._plain[name])
        index = int(parameters[0]) if parameters and re.fullmatch(r"\d", parameters[0]) else -1
        if name in self._of_output and 0 <= index <= 4:
            return self._told(name, self._of_output[name][index])
        if name == "DLAY" and index in self._delays:
            reference, delay_s = self._delays[index]
            return f"{reference},+{delay_s:.12f}\r\n".encode()
        return self._wrong(UNDEFINED)

    def _told(self, name: str, value: float) -> bytes:
        return (f"{value:+.2f}" if name in VOLTS else f"{value:.0f}").encode() + b"\r\n"

    def _change(self, name: str, parameters: list[str]) -> bytes:
        if name == "*CLS":
            self._errors.clear()
            return b""
        values = [_number(one) for one in parameters]
        if name == "DLAY":
            return self._delay(values)
        if name in PLAIN and len(values) == 1:
            low, high = PLAIN[name]
            if low <= values[0] <= high and (name in VOLTS or values[0].is_integer()):
                self._plain[name] = values[0]
                return b""
            return self._wrong(ILLEGAL_VALUE)
        if name in OF_OUTPUT and len(values) == 2:
            low, high, _ = OF_OUTPUT[name]
            if values[0] in range(5) and low <= values[1] <= high:
                self._of_output[name][int(values[0])] = values[1]
                return b""
            return self._wrong(ILLEGAL_VALUE)
        return self._wrong(MISSING if name in PLAIN or name in OF_OUTPUT else UNDEFINED)

    def _delay(self, values: list[float]) -> bytes:
        if len(values) != 3:
            return self._wrong(MISSING)
        channel, reference, delay_s = values
        if channel not in self._delays or reference not in (0, *self._delays):
            return self._wrong(ILLEGAL_VALUE)
        if not abs(delay_s) <= LONGEST_S:
            return self._wrong(ILLEGAL_DELAY)
        before = self._delays[int(channel)]
        self._delays[int(channel)] = int(reference), round(delay_s / STEP_S) * STEP_S
        since_t0_s = self._since_t0_s(int(channel))
        if not 0 <= since_t0_s <= LONGEST_S:
            self._delays[int(channel)] = before
            return self._wrong(ILLEGAL_LINK if since_t0_s == inf else ILLEGAL_DELAY)
        return b""

    def _since_t0_s(self, channel: int) -> float:
        """Return when a channel's delay ends; infinite where channels are delayed from each other."""
        total_s = 0.0
        for _ in range(9):
            if channel == 0:
                return total_s
            channel, delay_s = self._delays[channel]
            total_s += delay_s
        return inf

    def _wrong(self, error: int) -> bytes:
        self._errors = [*self._errors, error][-MOST_ERRORS:]
        return b""

    def _act(self) -> None:
        every = int(self._of_output["PRES"][0]) if self._plain["ADVT"] else 1
        self.move_gate(on=self._plain["TSRC"] in (1, 2), delay_s=self._since_t0_s(2), every=every)


def _number(text: str) -> float:
    """Return a number, or one that no setting takes."""
    return float(text) if re.fullmatch(r"[+-]?\d{1,20}(\.\d{0,20})?(E[+-]?\d{1,2})?", text) else inf
