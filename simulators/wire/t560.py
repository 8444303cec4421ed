"""The firmware of a Highland T560 delay generator, triggering the bench's gate.

Source: chapter 4 of its manual for lines and answers, two published drivers for the commands. UNCONFIRMED,
and so choices made here: what ``ID``, ``TRIGGER`` and ``TDIV`` answer, and the steps of delays. Output A
gates the detector.
"""

import re
from dataclasses import dataclass

from simulators.bench import Bench
from simulators.wire.delayer import DelayerFirmware

LONGEST_S = 10.0
STEP_S = 10e-12
INSERTION_S = 21e-9

#: Full names of the commands, by the two letters that are enough.
NAMES = {name[:2]: name for name in ("AUTOINSTALL", "VERBOSE", "TRIGGER", "TLEVEL", "TDIV", "INSTALL", "ID")}
NAMES |= {
    f"{channel}{what[0]}": f"{channel}{what}" for channel in "ABCD" for what in ("DELAY", "WIDTH", "SET")
}

UNITS_S = {"": 1e-9, "p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "s": 1.0}
TRIGGERS = ("OFF", "POS", "NEG", "REM", "SYN", "INT")


@dataclass
class Output:
    """One of the four."""

    positive: bool = True
    on: bool = False
    delay_s: float = 0.0
    width_s: float = 2e-6


class T560Box(DelayerFirmware):
    """A T560 as bytes in and bytes out.

    Parameters
    ----------
    bench
        Its gate follows output A.

    Attributes
    ----------
    knows_identity
        Whether it answers ``ID``.
    """

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench, insertion_delay_s=INSERTION_S, terminator=b"\r", longest=256)
        self.knows_identity = True
        self._outputs = {name: Output() for name in "ABCD"}
        self._waiting: dict[str, tuple[float, float]] = {}
        self._trigger = "OFF"
        self._numbers = {"AUTOINSTALL": 0.0, "VERBOSE": 1.0, "TLEVEL": 1.25, "TDIV": 0.0}
        self._act()

    def junk(self) -> bytes:
        """Answer what is no command."""
        return b"??\r\n"

    def obey(self, line: bytes) -> bytes:
        """Do the commands of a line in turn, up to the first that is wrong; answer each."""
        answers: list[str] = []
        for command in line.decode("ascii", "replace").replace("\n", "").rstrip(";").split(";"):
            answers.append(self._obey(command.strip()))
            if answers[-1] == "??":
                break
        if self._numbers["AUTOINSTALL"]:
            self._install()
        self._act()
        return ";".join(answers).encode() + b"\r\n"

    def _obey(self, command: str) -> str:
        word, _, argument = command.partition(" ")
        name, argument = self._name(word.upper()), argument.strip()
        if name == "ID" and not argument and self.knows_identity:
            return "Highland Technology T560-1 SN SIM0001"
        if name == "INSTALL" and not argument:
            self._install()
            return "OK"
        if name in self._numbers:
            return self._number(name, argument)
        if name == "TRIGGER":
            return self._trigger_by(argument.upper())
        if name[1:] in ("DELAY", "WIDTH"):
            return self._time(name, argument)
        if name[1:] == "SET":
            return self._set(name[0], argument.upper())
        return "??"

    def _name(self, word: str) -> str:
        """Return the full name of a command, given that or its two letters."""
        if word in NAMES:
            return NAMES[word]
        return word if word in NAMES.values() else ""

    def _number(self, name: str, argument: str) -> str:
        if not argument:
            return f"{self._numbers[name]:.3f}" if name == "TLEVEL" else f"{self._numbers[name]:.0f}"
        if not re.fullmatch(r"\d{1,9}(\.\d{0,9})?", argument):
            return "??"
        if name == "TLEVEL" and not 0.25 <= float(argument) <= 3.3:
            return "??"
        self._numbers[name] = float(argument)
        return "OK"

    def _trigger_by(self, argument: str) -> str:
        if not argument:
            level_v, divided = self._numbers["TLEVEL"], self._numbers["TDIV"]
            return f"Trig {self._trigger} HIZ Level {level_v:.3f} Div {divided:.0f}"
        if argument[:3] not in TRIGGERS:
            return "??"
        self._trigger = argument[:3]
        return "OK"

    def _time(self, name: str, argument: str) -> str:
        output = self._outputs[name[0]]
        delay_s, width_s = self._waiting.get(name[0], (output.delay_s, output.width_s))
        is_delay = name[1:] == "DELAY"
        if not argument:
            return self._told(output.delay_s if is_delay else output.width_s)
        told = re.fullmatch(r"(\d{1,12}(?:\.\d{0,12})?)\s*([pnums]?)", argument.lower())
        value_s = float(told[1]) * UNITS_S[told[2]] if told else LONGEST_S + 1
        if not value_s <= LONGEST_S:
            return "??"
        value_s = round(value_s / STEP_S) * STEP_S
        self._waiting[name[0]] = (value_s, width_s) if is_delay else (delay_s, value_s)
        return "OK"

    def _set(self, name: str, argument: str) -> str:
        output = self._outputs[name]
        if not argument:
            polarity, state = "POS" if output.positive else "NEG", "ON" if output.on else "OFF"
            times = f"Dly  {self._told(output.delay_s)}  Wid  {self._told(output.width_s)}"
            return f"Ch {name}  {polarity}  {state:<3}    {times}"
        if argument in ("ON", "OFF", "OF"):
            output.on = argument == "ON"
        elif argument[:2] in ("PO", "NE"):
            output.positive = argument[:2] == "PO"
        else:
            return "??"
        return "OK"

    def _told(self, time_s: float) -> str:
        plain = f"{time_s:015.12f}"
        if not self._numbers["VERBOSE"]:
            return plain
        whole, digits = plain.split(".")
        return f"{whole}.{','.join(digits[i : i + 3] for i in range(0, 12, 3))}"

    def _install(self) -> None:
        for name, (delay_s, width_s) in self._waiting.items():
            self._outputs[name].delay_s, self._outputs[name].width_s = delay_s, width_s
        self._waiting.clear()

    def _act(self) -> None:
        output = self._outputs["A"]
        on = output.on and self._trigger in ("POS", "NEG")
        self.move_gate(on=on, delay_s=output.delay_s, every=max(1, int(self._numbers["TDIV"])))
