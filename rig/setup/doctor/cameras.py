"""The cameras that see the relay wall."""

import sys
from collections.abc import Iterator
from pathlib import Path

from rig.model.config import RigConfig
from rig.setup.doctor.finding import Finding

#: Cameras by which a mirror is calibrated.
_NEEDED = 2


def check(config: RigConfig) -> Iterator[Finding]:
    """Return whether the configured cameras are there; a simulated rig has its own."""
    addresses = config.cameras.addresses
    if config.simulated or not addresses:
        return
    if len(addresses) != _NEEDED:
        yield Finding(
            "cameras",
            "warning",
            f"{len(addresses)} configured",
            f"Give {_NEEDED} as cameras.addresses, or none: then rig calibrate all uses no cameras",
        )
    yield from map(_one, addresses)


def _one(address: str) -> Finding:
    what = f"camera {address}"
    if "://" in address:
        return Finding(what, "ok", "a URL; it is tried when it is needed")
    number = address.isdecimal()
    if number and not sys.platform.startswith("linux"):
        return Finding(what, "ok", "a number; it is tried when it is needed")
    file = Path(f"/dev/video{address}" if number else address)
    if file.exists():
        return Finding(what, "ok", f"{file} exists")
    seen = ", ".join(map(str, sorted(Path("/dev").glob("video*")))) or "none"
    return Finding(what, "missing", f"no {file}; present: {seen}", "Plug it in, or correct cameras.addresses")
