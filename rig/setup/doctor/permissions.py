"""Whether this user may use the ports and instruments that are there."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

from drivers.harp.family import PICOQUANT
from drivers.id120 import ID120
from rig.model.config import HarpConfig, Id120Config, RigConfig
from rig.setup.doctor.finding import Finding

#: Where a rule for udev goes: after the system's own, before those that only name things.
RULES = "/etc/udev/rules.d/60-nlos-rig.rules"
_USB = Path("/sys/bus/usb/devices")


def check(config: RigConfig) -> Iterator[Finding]:
    """Return what is known of rights to the devices of a real rig."""
    if config.simulated:
        return
    if not sys.platform.startswith("linux"):
        yield Finding("rights", "ok", _ELSEWHERE.get(sys.platform, "serial ports need none on most systems"))
        return
    yield from _ports(config)
    for name, vendor in _on_usb(config):
        yield from _instruments(name, vendor, _USB)


_ELSEWHERE = {
    "win32": "serial ports need none, close other programs that use them; an ID120 on USB needs the driver "
    "WinUSB, which the program Zadig installs",
    "darwin": "serial ports need none; use the names that begin with /dev/cu.",
}


def _ports(config: RigConfig) -> Iterator[Finding]:
    for name, address in config.serial_addresses.items():
        if address is None or "://" in address or not Path(address).exists():
            continue
        what = f"rights: {name} at {address}"
        if os.access(address, os.R_OK | os.W_OK):
            yield Finding(what, "ok", "this user may use it")
        else:
            group = _group_of(Path(address))
            yield Finding(
                what,
                "missing",
                f"this user may not use it, the group {group} may",
                f"sudo usermod -aG {group} $USER    and then log out and in again",
            )


def _group_of(port: Path) -> str:
    if sys.platform == "win32":  # which has no groups of files
        return "dialout"
    try:
        return port.group()
    except (KeyError, OSError):
        return "dialout"


def _on_usb(config: RigConfig) -> Iterator[tuple[str, int]]:
    """Return the devices without a serial port, with their USB vendors."""
    if isinstance(config.detector, Id120Config) and not config.detector.address:
        yield "detector", ID120[0]
    if isinstance(config.tcspc, HarpConfig) and not config.tcspc.address:
        yield "timing instrument", PICOQUANT


def _instruments(name: str, vendor: int, devices: Path) -> Iterator[Finding]:
    """Return the rights to the USB devices of a vendor that the system lists."""
    for entry in sorted(devices.glob("*/idVendor")):
        if _read(entry) != f"{vendor:04x}":
            continue
        bus, number = (_read(entry.with_name(file)).zfill(3) for file in ("busnum", "devnum"))
        node = Path("/dev/bus/usb", bus, number)
        what = f"rights: {name} at {node}"
        if os.access(node, os.R_OK | os.W_OK):
            yield Finding(what, "ok", "this user may use it")
        else:
            yield Finding(what, "missing", "this user may not use it", rule(vendor))


def rule(vendor: int) -> str:
    """Return the commands that let everybody on this computer use the devices of a USB vendor."""
    text = f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{vendor:04x}", MODE="0666"'
    return f"echo '{text}' | sudo tee -a {RULES} && sudo udevadm control --reload && sudo udevadm trigger"


def _read(file: Path) -> str:
    try:
        return file.read_text(encoding="ascii", errors="replace").strip()
    except OSError:  # unplugged meanwhile
        return ""
