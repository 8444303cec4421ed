"""The questions by which a configuration is made; its own model checks each answer at once.

Answers may be known before: as a table that is written as a configuration is. What it says is not asked.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError

from drivers.errors import LimitError
from rig.devices.kinds import DELAYERS, DETECTORS, GALVOS, LASERS
from rig.errors import ConfigError, UsageError
from rig.model.config import DeviceSection, RigConfig
from rig.model.config.installed import names
from rig.model.config.kinds import ROLES
from rig.model.config.reading import explained
from rig.model.presets import Table, merged
from rig.model.quantities import parse
from rig.model.spelled import spelled
from rig.setup.described import descriptions, headline
from rig.setup.following import following, gate_opens_s
from rig.setup.found import Connected

#: What each role is, for people, in the order in which the light and its pulses pass them.
DEVICES = {
    "laser": "laser",
    "galvo": "steering mirror",
    "detector": "detector",
    "delayer": "gate delayer between the laser's sync pulse and the detector's gate",
    "tcspc": "timing instrument",
    "point_clock": "point clock, for scans in which the mirror never stops",
    "shutter": "shutter",
}
#: Roles that a rig need not have.
OPTIONAL = ("delayer", "point_clock", "shutter")
NONE = "none"
#: Keys that are asked beside the address and what has no default, by role and kind.
_ASKED = {
    ("galvo", "analogue"): ("device", "volts_per_degree"),
    ("point_clock", "daq"): ("device",),
    ("shutter", "daq"): ("device", "line"),
    ("shutter", "serial"): ("line",),
}
#: Mirror and detector stand so far to the left and right of the wall's middle, unless one says otherwise.
_ASIDE_M = 0.15


@dataclass(frozen=True)
class Question:
    """Something that is asked.

    Attributes
    ----------
    key
        Of the configuration, for messages.
    words
        The question.
    default
        What is taken where nothing is answered; empty where an answer is needed.
    choices
        What may be answered, each with what it is; anything if there are none, or if ``free``.
    free
        Whether other answers are allowed.
    """

    key: str
    words: str
    default: str = ""
    choices: Sequence[tuple[str, str]] = ()
    free: bool = False


#: Gives the answer to a question; for an empty one its default is taken.
Ask = Callable[[Question], str]


@dataclass
class Interview:
    """Asks for a rig.

    Attributes
    ----------
    ask
        Gives answers.
    say
        Gets what is wrong with an answer.
    found
        What is connected.
    table
        What is known so far, as a configuration has it.
    """

    ask: Ask
    say: Callable[[str], None]
    found: Sequence[Connected]
    table: Table = field(default_factory=dict)

    def rig(self) -> RigConfig:
        """Ask for all that is not known, and return the configuration.

        Raises
        ------
        ConfigError
            If what was known before is wrong.
        UsageError
            If an answer is needed and none comes.
        """
        if wrong := self._wrong(self.table):
            raise ConfigError(wrong)
        self._settle(("name",), Question("name", "Name of the rig", "lab"))
        for role in DEVICES:
            self._device(role)
        self._numbers()
        try:
            return RigConfig.model_validate(self.table)
        except ValidationError as error:
            raise ConfigError(explained(error)) from None

    def _device(self, role: str) -> None:
        if role in OPTIONAL and role not in self.table:
            self.table[role] = {}
        self._settle((role, "kind"), self._which(role))
        if self.table[role]["kind"] == NONE:
            del self.table[role]
            return
        section = self._section(role)
        fields, said = section.model_fields, descriptions(section)
        keys = {about.alias or name: name for name, about in fields.items()}
        wanted = [key for key, name in keys.items() if fields[name].is_required()]
        wanted += _ASKED.get((role, self.table[role]["kind"]), ())
        if section.needs_address and "simulation" not in self.table:
            self._settle((role, "address"), self._where(role, said.get("address", "")))
        for key in wanted:
            usual = fields[keys[key]].get_default()
            default = "" if fields[keys[key]].is_required() else _typed(usual, keys[key])
            self._settle((role, key), Question(f"{role}.{key}", said.get(keys[key], key), default))

    def _section(self, role: str) -> type[DeviceSection]:
        kind = str(self.table[role]["kind"])
        brought = None if kind in ROLES[role].kinds else ROLES[role].installed(kind)
        return brought.section if brought else ROLES[role].kinds[kind]

    def _which(self, role: str) -> Question:
        kinds = {kind: headline(section) for kind, section in ROLES[role].kinds.items()}
        kinds |= dict.fromkeys(names(role), "from an installed package")
        if role in OPTIONAL:
            kinds = {NONE: "none", **kinds}
        guesses = (one.guess[1] for one in self.found if one.guess and one.guess[0] == role)
        default = next(guesses, next(iter(kinds)))
        return Question(f"{role}.kind", f"Which {DEVICES[role]}?", default, list(kinds.items()))

    def _where(self, role: str, said: str) -> Question:
        taken = {one.get("address") for one in self.table.values() if isinstance(one, dict)}
        ports = [one for one in self.found if one.way == "serial" and one.address not in taken]
        guess = (role, self.table[role]["kind"])
        default = next((one.address for one in ports if one.guess == guess), "")
        words = f"Where is the {DEVICES[role].partition(' between')[0]}? {said}"
        return Question(
            f"{role}.address", words, default, [(one.address, one.said) for one in ports], free=True
        )

    def _numbers(self) -> None:
        """Ask for what no device says; what follows from it is worked out."""
        asked = {"mirror": ("galvo", -1), "detector": ("detector", 1)}
        if any("position" not in self.table[role] for role, _ in asked.values()):
            distance_m = self._length("Distance of mirror and detector from the relay wall", "2.5m")
            for role, side in asked.values():
                place = [spelled_text(side * _ASIDE_M), "0cm", spelled_text(distance_m)]
                self.table[role].setdefault("position", place)
        self._settle(("laser", "repetition"), self._of("laser", "repetition", "Pulses a second of the laser"))
        self._settle(
            ("timing", "electronics_delay"),
            Question(
                "timing.electronics_delay",
                "Delay of cables and electronics, sync pulse to light and detection to timing input "
                "(rig calibrate time-zero measures it)",
                "12.3ns",
            ),
        )
        if self._partly().detector.gated:
            opens = spelled_text(gate_opens_s(self._partly()), "_s")
            words = "Opening edge of the gate after the sync pulse (rig calibrate gate measures it)"
            self._settle(("detector", "gate_delay"), Question("detector.gate_delay", words, opens))
        self.table = merged(following(self._partly()), self.table)
        self._settle(("scan", "exposure"), Question("scan.exposure", "Exposure of each position", "1s"))

    def _of(self, role: str, key: str, words: str) -> Question:
        section = self._section(role)
        name = next(name for name, about in section.model_fields.items() if (about.alias or name) == key)
        return Question(f"{role}.{key}", words, _typed(section.model_fields[name].get_default(), name))

    def _length(self, words: str, default: str) -> float:
        while True:
            text = self._answer(Question("galvo.position", words, default))
            try:
                length_m = parse(text, "length")
                if length_m > 0:
                    return length_m
                self.say("it must be in front of the wall: a length above 0, e.g. 2.5m")
            except UsageError as problem:
                self.say(str(problem))

    def _settle(self, place: tuple[str, ...], question: Question) -> None:
        """Ask for a value until it fits, unless it is known."""
        if _at(self.table, place) is not None:
            return
        while True:
            given = self._answer(question)
            allowed = [choice for choice, _ in question.choices]
            if allowed and not question.free and given not in allowed:
                self.say(f"'{given}' is not one of {', '.join(allowed)}")
                continue
            changed = merged(self.table, _nested(place, _read(given)))
            wrong = "" if given == NONE else self._wrong(changed)
            if not wrong:
                self.table = changed
                return
            self.say(wrong)

    def _answer(self, question: Question) -> str:
        given = self.ask(question).strip() or question.default
        if given.isdecimal() and question.choices and 0 < int(given) <= len(question.choices):
            given = question.choices[int(given) - 1][0]
        if not given:
            raise UsageError(f"{question.key} has no default: it needs an answer ({question.words})")
        return given

    def _wrong(self, table: Table) -> str:
        """Return what is wrong with what is known; addresses may be missing yet."""
        try:
            rig = _of_known(table)
        except ValidationError as error:
            return explained(error)
        try:
            for kinds, section in ((GALVOS, rig.galvo), (LASERS, rig.laser), (DETECTORS, rig.detector)):
                kinds.of(section).check(section)
            if rig.delayer:
                DELAYERS.of(rig.delayer).check(rig.delayer)
        except LimitError as problem:
            return str(problem)
        return ""

    def _partly(self) -> RigConfig:
        return _of_known(self.table)


def _of_known(table: Table) -> RigConfig:
    """Return a rig of what is known, as a simulated one, which needs no addresses."""
    known = {name: one for name, one in table.items() if one != {"kind": NONE} and one != {}}
    return RigConfig.model_validate({"delayer": None, "simulation": {}, **known})


def spelled_text(value: float, ending: str = "_m") -> str:
    """Return a number as a quantity in text, by the ending of its field's name."""
    return spelled(value, ending).strip('"')


def _typed(value: Any, name: str) -> str:
    """Return a value as it is typed: a text without its quotation marks."""
    return spelled(value, name).strip('"')


def _read(text: str) -> Any:
    """Read what was typed: a list as TOML has it, all else as text, of which the model makes numbers."""
    if not text.startswith("["):
        return text
    import tomllib

    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text


def _at(table: Table, place: tuple[str, ...]) -> Any:
    found: Any = table
    for name in place:
        found = found.get(name) if isinstance(found, dict) else None
    return found


def _nested(place: tuple[str, ...], value: Any) -> Table:
    for name in reversed(place):
        value = {name: value}
    return dict(value)
