"""What is installed and connected, and what to do about what is missing. It only looks."""

import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from rig.model.config import ExternalDetectorConfig, HarpConfig, Id120Config, RigConfig

#: What a check says: all is well, something to look at, or something without which nothing works.
Verdict = Literal["ok", "warning", "missing"]

_PACKAGES = ("numpy", "scipy", "h5py", "matplotlib", "numba", "ducc0", "pyserial", "pyusb")


@dataclass(frozen=True)
class Finding:
    """The result of one check."""

    what: str
    verdict: Verdict
    found: str
    remedy: str = ""


def examine(config: RigConfig, folder: Path) -> list[Finding]:
    """Run all checks for the rig that a configuration names; simulated rigs need no hardware."""
    findings = [*_software(), _disk(folder)]
    findings += [Finding("set by hand", "warning", sentence) for sentence in config.unverified]
    if not config.simulated:
        findings += [*_ports(config), *_boards(config), *_detector(config), _timing_library(config)]
    return findings


def _software() -> Iterator[Finding]:
    yield Finding("Python", "ok", sys.version.split()[0])
    for package in _PACKAGES:
        try:
            yield Finding(package, "ok", version(package))
        except PackageNotFoundError:
            yield Finding(package, "missing", "not installed", f"Install it: pip install {package}")


def _disk(folder: Path) -> Finding:
    free = shutil.disk_usage(folder).free
    verdict: Verdict = "ok" if free > 2e9 else "warning"
    remedy = (
        "" if verdict == "ok" else "A long scan may need more; free some space or scan with --out elsewhere"
    )
    return Finding(f"disk space in {folder.resolve()}", verdict, f"{free / 1e9:.1f} GB free", remedy)


def _ports(config: RigConfig) -> Iterator[Finding]:
    from serial.tools import list_ports

    present = {str(Path(port.device).resolve()): port for port in list_ports.comports()}
    for name, address in config.serial_addresses.items():
        what = f"{name} at {address}"
        if address is None or "://" in address:
            yield Finding(what, "ok", "a URL; it is tried when a scan opens it")
        elif port := present.get(str(Path(address).resolve())):
            yield Finding(what, "ok", port.description)
        elif Path(address).exists():
            yield Finding(what, "warning", "exists, but is not listed as a serial port", "Check the address")
        else:
            seen = ", ".join(port.device for port in present.values()) or "none"
            yield Finding(
                what,
                "missing",
                f"no such port; present: {seen}",
                "Plug it in, switch it on, or correct the address",
            )


def _boards(config: RigConfig) -> Iterator[Finding]:
    from drivers.daq.board import SharedBoard
    from drivers.daq.nidaqmx_board import NidaqmxBoard
    from drivers.errors import DeviceError

    for device, address in config.boards.items():
        what = f"DAQ board {device}"
        if address:
            yield _served(f"served {what} at {address}", address)
            continue
        try:
            yield Finding(what, "ok", SharedBoard(NidaqmxBoard(device)).identity())
        except DeviceError as error:
            yield Finding(what, "missing", error.answered, error.remedy)


def _served(what: str, address: str) -> Finding:
    if Path(address).exists():
        return Finding(what, "ok", "there; it is tried when a scan opens it")
    remedy = "Start rig sim serve, and use the configuration that it writes"
    return Finding(what, "missing", "nothing is there", remedy)


def _detector(config: RigConfig) -> list[Finding]:
    """Look for a detector that has no serial port."""
    if isinstance(config.detector, Id120Config):
        return [_on_usb(config.detector)]
    if "detector" in config.serial_addresses:
        return []
    if isinstance(config.detector, ExternalDetectorConfig):
        return [Finding("detector", "ok", "no data interface: a person is asked")]
    return [Finding("detector", "ok", f"{config.detector.kind}: it is tried when a scan opens it")]


def _on_usb(detector: Id120Config) -> Finding:
    if detector.address:
        return _served(f"served detector at {detector.address}", detector.address)

    from drivers.errors import DeviceError
    from drivers.id120 import ID120
    from drivers.lines.usb_finder import find_instrument

    what = f"detector on USB ({ID120[0]:04x}:{ID120[1]:04x})"
    try:
        device = find_instrument("detector", vendor_product=ID120, serial=detector.serial)
    except DeviceError as error:
        return Finding(what, "missing", error.answered, error.remedy)
    if (device.idVendor, device.idProduct) != ID120:
        return Finding(
            what,
            "warning",
            f"another instrument is there, {device.idVendor:04x}:{device.idProduct:04x}",
            "Plug the detector in, unless this is it; it is asked for its name when a scan opens it",
        )
    return Finding(what, "ok", f"bus {device.bus}, address {device.address}")


def _timing_library(config: RigConfig) -> Finding:
    from drivers.errors import DeviceError
    from drivers.harp.loading import load_library
    from rig.devices.kinds.harps import family_of

    if not isinstance(config.tcspc, HarpConfig):
        return Finding("timing instrument", "ok", f"{config.tcspc.kind}: no instrument is needed")
    if config.tcspc.address:
        return _served(f"served bench at {config.tcspc.address}", config.tcspc.address)
    family = family_of(config.tcspc)
    what = f"{family.name} library"
    try:
        library = load_library(family, config.tcspc.library)
    except DeviceError as error:
        return Finding(what, "missing", error.answered, error.remedy)
    return Finding(what, "ok", f"version {library.get_library_version()}")
