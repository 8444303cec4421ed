"""The kinds of point clocks."""

from contextlib import AbstractContextManager

from drivers.daq.point_clock import DaqPointClock, PulseLines
from rig.devices.kinds.kind import Kind, Kinds
from rig.devices.kinds.wires import Wires
from rig.model.config import DaqClockConfig
from rig.model.devices import PointClock


def open_daq_clock(config: DaqClockConfig, wires: Wires) -> AbstractContextManager[PointClock]:
    """Return the point clock, to be entered."""
    return DaqPointClock(wires.daq(config.device), PulseLines(config.markers, config.step or None))


POINT_CLOCKS: Kinds[Kind[PointClock]] = Kinds("point_clock", Kind(DaqClockConfig, open_daq_clock))
