"""What is connected to this computer. Nothing is opened, and no byte is sent to a device."""

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from drivers.harp.family import PICOQUANT
from rig.model.config import HarpConfig
from rig.model.config.kinds import ROLES

#: Linux keeps a name here for each serial port that says who it is; it follows the device, not the socket.
BY_ID = Path("/dev/serial/by-id")
#: What is said of a port that says nothing of what is behind it.
SILENT = "reports no identity"
#: Class of hubs, which are no instruments.
_HUB = 9
#: Words by which makers name what is behind a port, for a first guess. Adapters name themselves alone.
_WORDS = {
    ("galvo", "optotune"): r"optotune|\bMR-E",
    ("laser", "katana"): r"katana|onefive",
    ("laser", "nkt"): r"\bNKT\b|superk",
    ("delayer", "dg645"): r"DG645|stanford research",
    ("delayer", "t560"): r"\bT56[04]\b|highland",
}


@dataclass(frozen=True)
class Connected:
    """Something that is connected.

    Attributes
    ----------
    address
        What a configuration calls it: a serial port, USB identifiers, a board's or a library's name.
    said
        What it says of itself, for people.
    way
        How it is connected: ``serial``, ``usb``, ``daq`` or ``library``.
    guess
        Role and kind that this may be; None where nothing speaks for one.
    """

    address: str
    said: str
    way: str
    guess: tuple[str, str] | None = None

    @property
    def speaks(self) -> bool:
        """Whether it may be a device of a rig, as far as it can be seen."""
        return self.guess is not None or (self.way == "serial" and self.said != SILENT)


def connected() -> list[Connected]:
    """Return what is there: serial ports, instruments on USB, DAQ boards, and libraries of vendors."""
    return [*_ports(), *_instruments(), *_boards(), *_libraries()]


def _ports() -> Iterator[Connected]:
    from serial.tools import list_ports

    stable = {link.resolve(): str(link) for link in sorted(BY_ID.glob("*"))} if BY_ID.is_dir() else {}
    for port in sorted(list_ports.comports()):
        words = [port.manufacturer, port.product or port.description, port.serial_number]
        said = ", ".join(word for word in words if word and word != "n/a") or SILENT
        guess = next((role for role, pattern in _WORDS.items() if re.search(pattern, said, re.I)), None)
        yield Connected(stable.get(Path(port.device).resolve(), port.device), said, "serial", guess)


def _instruments() -> Iterator[Connected]:
    import usb.core

    from drivers.id120 import ID120
    from drivers.lines.usb_finder import listed

    try:
        devices = [one for one in listed() if one.bDeviceClass != _HUB]
    except usb.core.NoBackendError:
        return  # the doctor says what to install, for rigs that need it
    for one in devices:
        address = f"{one.idVendor:04x}:{one.idProduct:04x}"
        if (one.idVendor, one.idProduct) == ID120:
            yield Connected(address, "ID Quantique ID120", "usb", ("detector", "id120"))
        else:
            said = "a PicoQuant instrument" if one.idVendor == PICOQUANT else "an unknown instrument"
            yield Connected(address, said, "usb")


def _boards() -> Iterator[Connected]:
    try:
        from nidaqmx.system import System

        for board in System.local().devices:
            yield Connected(board.name, board.product_type, "daq", ("point_clock", "daq"))
    except Exception:  # no package, no NI-DAQmx behind it: each has errors of its own
        return


def _libraries() -> Iterator[Connected]:
    from drivers.errors import DeviceError
    from drivers.harp.loading import load_library
    from rig.devices.kinds.harps import family_of

    for kind, section in ROLES["tcspc"].kinds.items():
        if not issubclass(section, HarpConfig):
            continue
        family = family_of(section())
        with suppress(DeviceError):  # not installed
            library = load_library(family)
            said = f"{family.name} library {library.get_library_version()}"
            yield Connected(library.name, said, "library", ("tcspc", kind))
