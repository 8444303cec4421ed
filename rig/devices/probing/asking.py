"""How devices are asked: one question after the other on an open line, each answer taken as it comes.

Nothing here goes through a device's driver class, because entering and leaving one sets things: the mirror
goes to rest, the laser is told to be dark, the detector loses its bias.
"""

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceNotFoundError, LinkError
from drivers.harp.library import HarpLibrary
from drivers.lines.serial import SerialLine
from drivers.lines.usb_finder import find_instrument
from drivers.lines.usbtmc import UsbTmc
from drivers.nkt.bus import NktBus
from rig.devices.kinds import Wires
from rig.devices.kinds.harps import family_of

#: Longest wait for the first byte of an answer, and for another one after the last.
WITHIN_S, QUIET_S = 0.6, 0.15
POLL_S = 0.01
#: An instrument on USB may take longer; the one public driver of an ID120 waits 20 s.
USB_WITHIN_S = 2.0
#: A line that goes on for so long is not answering.
MOST_CHARACTERS = 20_000
#: After so many questions without an answer from the first on, a device is not asked any more.
SILENT = 3


@dataclass(frozen=True)
class Exchange:
    """A question, and what came of it.

    Attributes
    ----------
    question
        As it was asked, without what ends it.
    answer
        All that came, in text, without blanks around it; None if nothing did.
    problem
        Why nothing came: the name of an error code, or a sentence.
    private
        The answer is a serial number.
    """

    question: str
    answer: str | None
    problem: str = ""
    private: bool = False


class Asking(Protocol):
    """Asks a device of one kind."""

    def __call__(self, section: Any, wires: Wires) -> Iterator[Exchange]:
        """Ask, given its section of the configuration.

        Raises
        ------
        drivers.errors.DeviceError
            If it cannot be reached, or is gone.
        """
        ...


@dataclass(frozen=True)
class TextLine:
    """Questions as lines of text over a serial port.

    Attributes
    ----------
    address
        Where it is.
    baudrate, terminator
        Of the line.
    questions
        In their order.
    private
        Those whose answer is a serial number.
    """

    address: Callable[[Wires], str]
    baudrate: int
    terminator: bytes
    questions: tuple[str, ...]
    private: tuple[str, ...] = ()

    def __call__(self, section: Any, wires: Wires) -> Iterator[Exchange]:
        """Ask; see `Asking`."""
        line = SerialLine(
            self.address(wires),
            device="device",
            baudrate=self.baudrate,
            terminator=self.terminator,
            timeout_s=WITHIN_S,
        )
        line.open()
        with closing(line):
            yield from _until_silent(self.questions, self.private, lambda one: _said(line, one, wires.clock))


def _said(line: SerialLine, question: str, clock: Clock) -> str:
    """Ask, and return all that comes until the line falls silent: also what nobody expects."""
    line.tell(question)
    said, until_s = "", clock.now_s() + WITHIN_S
    while clock.now_s() < until_s and len(said) < MOST_CHARACTERS:
        if came := line.pending():  # over a network it comes byte by byte
            said, until_s = said + came, clock.now_s() + QUIET_S
        else:
            clock.sleep(POLL_S)
    if not said:
        raise LinkError(line.name, f"answer {question!r}", f"no answer came in {WITHIN_S:g} s", "")
    return said


@dataclass(frozen=True)
class Instrument:
    """Questions as messages to an instrument of the USB Test and Measurement Class.

    Attributes
    ----------
    vendor_product
        USB identifiers by which it is found.
    questions, private
        As of `TextLine`.
    """

    vendor_product: tuple[int, int]
    questions: tuple[str, ...]
    private: tuple[str, ...] = ()

    def __call__(self, section: Any, wires: Wires) -> Iterator[Exchange]:
        """Ask; see `Asking`."""
        found = find_instrument(
            "device", vendor_product=self.vendor_product, serial=section.serial, backend=wires.usb_backend
        )
        name = f"device at USB {found.idVendor:04x}:{found.idProduct:04x}"
        if (found.idVendor, found.idProduct) != self.vendor_product:
            raise DeviceNotFoundError(
                name, "be the detector", "it is another instrument", "Plug the detector in."
            )
        link = UsbTmc(found, name=name, clock=wires.clock, timeout_s=USB_WITHIN_S)

        def said(question: str) -> str:
            link.write(question.encode("ascii") + b"\n")
            return link.read(f"answer {question!r}").decode("ascii", "backslashreplace")

        with closing(link):
            link.open()
            yield Exchange("USB488", str(link.usb488))
            yield from _until_silent(self.questions, self.private, said)


@dataclass(frozen=True)
class Registers:
    """Registers of an NKT mainboard, read.

    Attributes
    ----------
    names
        Number and name of each register.
    private
        Names of those that hold a serial number.
    """

    names: dict[int, str]
    private: tuple[str, ...] = ()

    def __call__(self, section: Any, wires: Wires) -> Iterator[Exchange]:
        """Ask; see `Asking`. Answers are hexadecimal, serial numbers text."""
        bus = NktBus(wires.laser, clock=wires.clock, timeout_s=WITHIN_S)
        questions = {name: number for number, name in self.names.items()}

        def said(question: str) -> str:
            data = bus.read_bytes(questions[question])
            return data.decode("latin-1") if question in self.private else data.hex(" ")

        bus.open()
        try:
            yield from _until_silent(tuple(questions), self.private, said)
        finally:
            bus.close()


def ask_harps(section: Any, wires: Wires) -> Iterator[Exchange]:
    """Ask all instruments of a family that can be opened, without initializing them, which resets them.

    Raises
    ------
    DeviceNotFoundError
        If none can be opened.
    """
    family = family_of(section)
    library = wires.harp(family)
    yield Exchange(f"{family.prefix}_GetLibraryVersion", library.get_library_version())
    found = 0
    for index in range(family.devices):
        question = f"{family.prefix}_OpenDevice({index})"
        opened = _tried(question, partial(library.open_device, index), private=True)
        if opened.problem == "DEVICE_OPEN_FAIL":  # nothing is there
            continue
        yield opened
        if opened.answer is None:
            continue
        found += 1
        try:
            yield from _uninitialized(library, index)
        finally:
            library.close_device(index)
    if not found:
        raise DeviceNotFoundError(
            family.name, f"open it through {library.name}", "none can be opened", "Check power and cable."
        )


def _uninitialized(library: HarpLibrary, index: int) -> Iterator[Exchange]:
    questions: tuple[tuple[str, Callable[[int], object]], ...] = (
        ("GetHardwareInfo", library.get_hardware_info),
        ("GetFeatures", library.get_features),
        ("GetBaseResolution", library.get_base_resolution),
        ("GetNumOfInputChannels", library.get_num_of_input_channels),
        ("GetFlags", library.get_flags),
    )
    for name, ask in questions:
        yield _tried(f"{library.family.prefix}_{name}({index})", partial(_as_text, ask, index))


def _as_text(ask: Callable[[int], object], index: int) -> str:
    return str(ask(index))


def ask_board(section: Any, wires: Wires) -> Iterator[Exchange]:
    """Ask a DAQ board who it is, and how fast it plays."""
    board = wires.daq(section.device)
    yield Exchange("identity", board.identity())
    yield _tried("fastest, lines", lambda: f"{board.fastest_hz(analogue=False):.0f} Hz")
    yield _tried("fastest, lines and channels", lambda: f"{board.fastest_hz(analogue=True):.0f} Hz")


def _until_silent(
    questions: tuple[str, ...], private: tuple[str, ...], ask: Callable[[str], str]
) -> Iterator[Exchange]:
    """Ask all questions; give up on a device that has answered none of the first ones."""
    unanswered: list[Exchange] = []
    for number, question in enumerate(questions, 1):
        exchange = _tried(question, partial(ask, question), private=question in private)
        yield exchange
        if exchange.answer is None:
            unanswered.append(exchange)
        if number == len(unanswered) == min(SILENT, len(questions)):
            raise LinkError("device", "answer", unanswered[0].problem, "Check power, cable and address.")


def _tried(question: str, ask: Callable[[], str], *, private: bool = False) -> Exchange:
    try:
        return Exchange(question, ask().strip(), private=private)
    except DeviceError as problem:
        return Exchange(question, None, getattr(problem, "code_name", problem.answered), private)
