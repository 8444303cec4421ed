"""Making a laser dark that no program has in its hands."""

from drivers.errors import FoundEmittingError
from rig.devices.by_hand import LaserByHand
from rig.devices.wires import laser_by_address
from rig.model.config import RigConfig


def make_dark(config: RigConfig) -> str:
    """Open a laser, which puts it out, and return in words how it was found.

    Raises
    ------
    DeviceError
        If it cannot be opened, does not confirm that it is dark, or is switched by hand: it has to be treated
        as emitting.
    """
    try:
        with laser_by_address(config) as laser:
            if isinstance(laser, LaserByHand):
                raise laser.refusal()
            return "the laser was dark" if config.shutter is None else "the shutter is closed"
    except FoundEmittingError as found:
        return str(found)
