"""The wires of a real rig, as its configuration names them."""

from drivers.clock import Clock, SystemClock
from drivers.hydraharp.library import HHLib
from drivers.hydraharp.loading import load_library
from rig.devices.kinds import Wires
from rig.model.config import HydraHarpConfig, RigConfig


def real_wires(config: RigConfig, clock: Clock | None = None) -> Wires:
    """Return where the drivers find the devices of a real rig; nothing is opened yet."""

    def hhlib() -> HHLib:
        return load_library(config.tcspc.library if isinstance(config.tcspc, HydraHarpConfig) else None)

    return Wires(
        galvo=config.galvo.address or "",
        laser=config.laser.address or "",
        usb_backend=None,
        hhlib=hhlib,
        clock=clock or SystemClock(),
    )
