"""Whether the devices of a real rig are connected: looked for, never asked."""

from collections.abc import Iterator
from pathlib import Path

from rig.model.config import ExternalDetectorConfig, Id120Config, RigConfig
from rig.setup.doctor.finding import Finding


def check(config: RigConfig) -> Iterator[Finding]:
    """Return what is known of each device; of a simulated rig only what a person sets."""
    for sentence in config.unverified:
        yield Finding("set by hand", "warning", sentence)
    if not config.simulated:
        yield from _ports(config)
        yield from _boards(config)
        yield from _detector(config)


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
                f"Plug it in, switch it on, or correct {name}.address",
            )


def _boards(config: RigConfig) -> Iterator[Finding]:
    from drivers.daq.board import SharedBoard
    from drivers.daq.nidaqmx_board import NidaqmxBoard
    from drivers.errors import DeviceError

    for device, address in config.boards.items():
        what = f"DAQ board {device}"
        if address:
            yield served(f"served {what} at {address}", address)
            continue
        try:
            yield Finding(what, "ok", SharedBoard(NidaqmxBoard(device)).identity())
        except DeviceError as error:
            yield Finding(what, "missing", error.answered, error.remedy)


def served(what: str, address: str) -> Finding:
    """Return whether a bench is there that another program serves."""
    if Path(address).exists():
        return Finding(what, "ok", "found; it is tried when a scan opens it")
    remedy = "Start rig sim serve, and use the configuration that it writes"
    return Finding(what, "missing", "nothing was found", remedy)


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
        return served(f"served detector at {detector.address}", detector.address)

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
            f"another instrument was found, {device.idVendor:04x}:{device.idProduct:04x}",
            "Plug the detector in, unless this is the detector; it is asked for its name when a scan "
            "opens it",
        )
    return Finding(what, "ok", f"bus {device.bus}, address {device.address}")
