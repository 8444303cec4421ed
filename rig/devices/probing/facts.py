"""The unconfirmed facts that harmless questions settle: what is believed, which answer settles it, and how.

The one table of them. Where the program stands on one, a comment there says UNCONFIRMED; docs/bench.md
has these by name, and those that no harmless question settles.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum

from drivers.katana.dialects import MEASURED_DARK_W, parse_emission, parse_rate, parse_value
from drivers.mpd import status as mpd
from drivers.nkt import registers as nkt
from rig.devices.probing.asking import Exchange

#: What a device answered, by question.
Answers = Mapping[str, Exchange]


class Verdict(StrEnum):
    """What became of a fact."""

    CONFIRMED = "confirmed"
    CONTRADICTED = "contradicted"
    NOT_SEEN = "not seen"


@dataclass(frozen=True)
class Fact:
    """Something that is believed of a device.

    Attributes
    ----------
    name
        By which docs/bench.md has it.
    section, kind
        The device, as of a configuration.
    believed
        What is believed, and who says so.
    settled_by
        The question whose answer settles it.
    judge
        Says by the answers what became of it; called only where the device answered something.
    """

    name: str
    section: str
    kind: str
    believed: str
    settled_by: str
    judge: Callable[[Answers], Verdict]


def verdict(fact: Fact, answers: Answers) -> Verdict:
    """Return what the answers of a device say of a fact."""
    if fact.settled_by not in answers or all(one.answer is None for one in answers.values()):
        return Verdict.NOT_SEEN
    return fact.judge(answers)


def _confirmed_if(holds: bool) -> Verdict:
    return Verdict.CONFIRMED if holds else Verdict.CONTRADICTED


def _answered(question: str, fits: Callable[[str], bool]) -> Callable[[Answers], Verdict]:
    """Return a judge: the question is answered, and so."""

    def judge(answers: Answers) -> Verdict:
        answer = answers[question].answer
        return _confirmed_if(answer is not None and fits(answer))

    return judge


def _refused(question: str, code_name: str) -> Callable[[Answers], Verdict]:
    """Return a judge: the question is refused with this code."""
    return lambda answers: _confirmed_if(answers[question].problem == code_name)


def _form(question: str, pattern: str) -> Callable[[Answers], Verdict]:
    """Return a judge: the whole answer has this form."""
    return _answered(question, lambda answer: re.fullmatch(pattern, answer) is not None)


def _katana(question: str) -> Callable[[Answers], Verdict]:
    """Return a judge: a Katana gives the setting's value in a form that the driver reads."""
    return _answered(question, lambda answer: parse_value(question.rstrip("?"), answer) is not None)


def _seen(question: str, judged: Callable[[str], Verdict]) -> Callable[[Answers], Verdict]:
    """Return a judge of an answer; without one nothing is seen."""

    def judge(answers: Answers) -> Verdict:
        answer = answers[question].answer
        return Verdict.NOT_SEEN if answer is None else judged(answer)

    return judge


def _rate_without_unit(answer: str) -> Verdict:
    """Judge whether the rate is in Hz, as the help says, or in MHz, as the driver takes small numbers."""
    rate = parse_rate("ltg_freq", answer)
    if rate is None:
        return Verdict.CONTRADICTED
    return _confirmed_if(parse_value("ltg_freq", answer) == rate)


def _dark(answers: Answers) -> Verdict:
    """Judge what an 08HP measures while it says that it is dark."""
    emission, measured = answers["le?"].answer, answers["lpa?"].answer
    watt = None if measured is None else parse_value("lpa", measured)
    if watt is None or emission is None or parse_emission("le", emission) is not False:
        return Verdict.NOT_SEEN
    return _confirmed_if(watt <= MEASURED_DARK_W)


def _picker_width(answer: str) -> Verdict:
    """Judge the width of the pulse picker's register: one byte below 256, two from there on."""
    data = bytes.fromhex(answer)
    picked = int.from_bytes(data, "little")
    return _confirmed_if(len(data) == (1 if picked < 256 else 2)) if picked else Verdict.NOT_SEEN


def _without_picker(answers: Answers) -> Verdict:
    """Judge what a laser without a pulse picker answers: that it has no such register, or 0."""
    asked = answers["pulse picker"]
    if asked.answer is not None and int.from_bytes(bytes.fromhex(asked.answer), "little"):
        return Verdict.NOT_SEEN  # it has one
    return _confirmed_if(asked.answer is not None or "not possible" in asked.problem)


def _emission_and_status(answers: Answers) -> Verdict:
    emission, status = answers["emission"].answer, answers["status"].answer
    if emission is None or status is None:
        return Verdict.NOT_SEEN
    said = bytes.fromhex(status)[0] & nkt.STATUS_EMISSION
    return _confirmed_if(bool(bytes.fromhex(emission)[0]) == bool(said))


def _names_of_mpd(answer: str) -> Verdict:
    found = set(re.findall(r"[A-Z]{2,4}(?=-?\d)", answer))
    return _confirmed_if(found.issuperset(mpd.NEEDED))


def _is_number(answer: str) -> bool:
    return re.fullmatch(r"-?\d+(\.\d+)?", answer) is not None


FACTS: tuple[Fact, ...] = (
    Fact(
        "optotune-getsn",
        "galvo",
        "optotune",
        "The manual lists GETSN; that each firmware knows it, and answers with a name, is not confirmed.",
        "GETSN",
        _answered("GETSN", lambda said: said not in ("NO", "OK", "ERROR") and said.isprintable()),
    ),
    Fact(
        "optotune-status",
        "galvo",
        "optotune",
        "STATUS is a hexadecimal number of up to 32 bits (manual); one public driver expects OK.",
        "STATUS",
        _form("STATUS", r"(0[xX])?[0-9a-fA-F]{1,8}"),
    ),
    Fact(
        "optotune-gettemp",
        "galvo",
        "optotune",
        "The manual lists GETTEMP; no public driver asks it. It is not confirmed that it answers with a "
        "number.",
        "GETTEMP",
        _answered("GETTEMP", lambda said: re.search(r"\d", said) is not None),
    ),
    *(
        Fact(
            f"katana-05-{question.rstrip('?')}",
            "laser",
            "katana",
            f"{question} is answered as name=number or status: number (the form is unconfirmed).",
            question,
            _katana(question),
        )
        for question in ("leg?", "lp?", "lps?", "ltg?", "ltg_freq?")
    ),
    Fact(
        "katana-05-rate-unit",
        "laser",
        "katana",
        "ltg_freq? is in Hz (the unit's help); a number below 1000, or one followed by MHz, counts as MHz.",
        "ltg_freq?",
        _seen("ltg_freq?", _rate_without_unit),
    ),
    Fact(
        "katana-05-help",
        "laser",
        "katana",
        "h lists the commands, leg among them (a published class keeps such a list).",
        "h",
        _answered("h", lambda said: re.search(r"\bleg\b", said) is not None),
    ),
    Fact(
        "katana-05-no-interlock",
        "laser",
        "katana",
        "No command asks for the interlock: the published list of commands has none.",
        "h",
        _seen("h", lambda said: _confirmed_if("interlock" not in said.lower())),
    ),
    Fact(
        "katana-08hp-le",
        "laser",
        "katana-08hp",
        "le? reports whether it emits, as 0 or 1; no published driver asks it.",
        "le?",
        _answered("le?", lambda said: parse_emission("le", said) is not None),
    ),
    *(
        Fact(
            f"katana-08hp-{question.rstrip('?')}",
            "laser",
            "katana-08hp",
            f"{question} is answered; published drivers set it and do not ask.",
            question,
            _katana(question),
        )
        for question in ("lps?", "lts?", "lx_freq?")
    ),
    Fact(
        "katana-08hp-dark",
        "laser",
        "katana-08hp",
        f"Dark, it measures at most {MEASURED_DARK_W * 1e3:g} mW (lpa?); a guess. Seen where le? says 0.",
        "lpa?",
        _dark,
    ),
    Fact(
        "nkt-type",
        "laser",
        "nkt",
        "Register 61 has the module's type, 60 or 88 (register files, as published drivers quote them).",
        "type",
        _seen("type", lambda said: _confirmed_if(bytes.fromhex(said)[0] in nkt.MAINBOARDS)),
    ),
    Fact(
        "nkt-interlock",
        "laser",
        "nkt",
        "Register 32: the low byte is 0, 1 or 2, the high byte a place out of the published list.",
        "interlock",
        _seen(
            "interlock",
            lambda said: _confirmed_if(
                len(data := bytes.fromhex(said)) == 2 and data[0] <= 2 and data[1] in nkt.OPEN_AT
            ),
        ),
    ),
    Fact(
        "nkt-picker-width",
        "laser",
        "nkt",
        "Register 34, the pulse picker, is read as one byte below 256, else as two.",
        "pulse picker",
        _seen("pulse picker", _picker_width),
    ),
    Fact(
        "nkt-no-picker",
        "laser",
        "nkt",
        "A laser without a pulse picker answers 0 for register 34, or that it has no such register; a guess.",
        "pulse picker",
        _without_picker,
    ),
    Fact(
        "nkt-emission-status",
        "laser",
        "nkt",
        "Bit 0 of register 66 reports emission like register 30. This does not show how both change "
        "while emission starts.",
        "status",
        _emission_and_status,
    ),
    Fact(
        "id120-idn",
        "detector",
        "id120",
        "The answer to *IDN? contains ID120; the answer of a real one is not confirmed.",
        "*IDN?",
        _answered("*IDN?", lambda said: "ID120" in said),
    ),
    Fact(
        "id120-capability",
        "detector",
        "id120",
        "A CAPABILITY? answers lowest, highest and step, in this order; the form is a guess.",
        "DEADTIME:CAPABILITY?",
        _form("DEADTIME:CAPABILITY?", r"\D*40\D+1000000\D+40\D*"),
    ),
    Fact(
        "id120-state",
        "detector",
        "id120",
        "REG:STATE? answers with a word; the possible words are not confirmed.",
        "REG:STATE?",
        _form("REG:STATE?", r"[A-Za-z_ ]+"),
    ),
    Fact(
        "id120-flags",
        "detector",
        "id120",
        "REG:RUN? and BIAS:ERROR_STATUS? answer TRUE or FALSE (one public driver).",
        "REG:RUN?",
        _form("REG:RUN?", "TRUE|FALSE"),
    ),
    Fact(
        "id120-temperature",
        "detector",
        "id120",
        "REG:MEASURED_TEMP? is a number in thousandths of a degree (one public driver).",
        "REG:MEASURED_TEMP?",
        _answered("REG:MEASURED_TEMP?", lambda said: _is_number(said) and 1000 < abs(float(said)) < 100_000),
    ),
    Fact(
        "mpd-status",
        "detector",
        "mpd",
        "AQ;DC is answered with the names that one published driver reads, by this firmware too.",
        "AQ;DC",
        _seen("AQ;DC", _names_of_mpd),
    ),
    Fact(
        "psd-longest",
        "delayer",
        "psd",
        "RMD is answered with the longest fine delay (one published driver).",
        "RMD",
        _answered("RMD", lambda said: re.fullmatch(r"(RMD#)?\d+#", said) is not None),
    ),
    Fact(
        "psd-temperature",
        "delayer",
        "psd",
        "RT is answered with a temperature in degrees (one published driver).",
        "RT",
        _answered("RT", lambda said: re.fullmatch(r"(RT#)?-?\d+#", said) is not None),
    ),
    Fact(
        "psd-echo",
        "delayer",
        "psd",
        "Its echo, if it is on, is the question and # (two published drivers). Seen where the echo is on.",
        "RD",
        _seen(
            "RD",
            lambda said: Verdict.NOT_SEEN if said.count("#") < 2 else _confirmed_if(said.startswith("RD#")),
        ),
    ),
    Fact(
        "dg645-numbers",
        "delayer",
        "dg645",
        "Numbers are written in digits with a sign, a point and an exponent at most; "
        "one source has the form.",
        "TLVL?",
        _form("TLVL?", r"[+-]?\d+(\.\d*)?([eE][+-]?\d+)?"),
    ),
    Fact(
        "dg645-delay",
        "delayer",
        "dg645",
        "DLAY? is answered with the number of a channel, a comma, and seconds.",
        "DLAY?2",
        _form("DLAY?2", r"\d,\s*[+-]?\d+(\.\d*)?([eE][+-]?\d+)?"),
    ),
    Fact(
        "t560-id",
        "delayer",
        "t560",
        "ID is answered with a name, or with ?? where it is not known; one source has it.",
        "ID",
        _answered("ID", lambda said: said not in ("", "OK") and said.isprintable()),
    ),
    Fact(
        "t560-channel",
        "delayer",
        "t560",
        "ASET is answered with channel, polarity, state, delay and width on one line (the maker's manual).",
        "ASET",
        _form("ASET", r"(?i)Ch\s+A\s+(POS|NEG)\s+(ON|OFF?)\s+Dly\s+[\d.,]+\s+Wid\s+[\d.,]+"),
    ),
    Fact(
        "t560-trigger",
        "delayer",
        "t560",
        "TRIGGER is answered with the edge, POS or NEG, among other words; one source has it.",
        "TRIGGER",
        _seen(
            "TRIGGER",
            lambda said: _confirmed_if(re.search(r"\b(POS|NEG|OFF|SYN|REM)", said.upper()) is not None),
        ),
    ),
    Fact(
        "t560-divider",
        "delayer",
        "t560",
        "TDIV is answered with a number; one source has it.",
        "TDIV",
        _form("TDIV", r"[\d,]+(\.\d*)?"),
    ),
    *(
        Fact(
            f"{kind}-not-initialized",
            "tcspc",
            kind,
            f"Between {prefix}_OpenDevice and {prefix}_Initialize questions are refused as -22, "
            "NOT_INITIALIZED (the header has the code; it is not known when it comes).",
            f"{prefix}_GetFeatures(0)",
            _refused(f"{prefix}_GetFeatures(0)", "NOT_INITIALIZED"),
        )
        for kind, prefix in (
            ("hydraharp", "HH"),
            ("multiharp", "MH"),
            ("picoharp330", "PH330"),
            ("timeharp260", "TH260"),
            ("hydraharp500", "HH500"),
        )
    ),
    *(
        Fact(
            f"daq-{what}",
            section,
            kind,
            f"The board plays {played} from its buffer: NI-DAQmx reports the highest rate for that.",
            question,
            _answered(question, lambda said: float(said.split()[0]) > 0),
        )
        for what, section, kind, played, question in (
            ("lines", "point_clock", "daq", "lines", "fastest, lines"),
            ("channels", "galvo", "analogue", "lines and channels", "fastest, lines and channels"),
        )
    ),
)
