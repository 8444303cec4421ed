"""The kinds of devices: for each role, from the kind that a configuration names to what opens it.

A new device of a known role costs its driver, its simulator at the wire, its section in `rig.model.config`,
and a line in its role's table.
"""

from rig.devices.kinds.delayers import DELAYERS, check_trigger
from rig.devices.kinds.detectors import DETECTORS
from rig.devices.kinds.galvos import GALVOS, loading
from rig.devices.kinds.kind import Kind, Kinds
from rig.devices.kinds.lasers import LASERS
from rig.devices.kinds.point_clocks import POINT_CLOCKS
from rig.devices.kinds.shutters import SHUTTERS
from rig.devices.kinds.timing import TIMING, Tagging, TimingKind, time_axis, timing_limits
from rig.devices.kinds.wires import Wires
from rig.model.config import RigConfig

__all__ = [
    "DELAYERS",
    "DETECTORS",
    "GALVOS",
    "LASERS",
    "POINT_CLOCKS",
    "SHUTTERS",
    "TIMING",
    "Kind",
    "Kinds",
    "Tagging",
    "TimingKind",
    "Wires",
    "check_settings",
    "loading",
    "time_axis",
    "timing_limits",
]


def check_settings(config: RigConfig) -> None:
    """Raise `drivers.errors.LimitError` unless the devices can be set as configured."""
    GALVOS.of(config.galvo).check(config.galvo)
    LASERS.of(config.laser).check(config.laser)
    DETECTORS.of(config.detector).check(config.detector)
    if config.delayer:
        DELAYERS.of(config.delayer).check(config.delayer)
        check_trigger(config.delayer, config.laser.repetition_hz)
    TIMING.of(config.tcspc).check(config)
