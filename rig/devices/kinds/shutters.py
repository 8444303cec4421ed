"""The kinds of shutters."""

from contextlib import AbstractContextManager

from drivers.shutters.daq import DaqShutter
from drivers.shutters.serial_port import SerialShutter
from rig.devices.kinds.kind import Kind, Kinds
from rig.devices.kinds.wires import Wires
from rig.model.config import DaqShutterConfig, SerialShutterConfig
from rig.model.devices import Shutter


def open_daq_shutter(config: DaqShutterConfig, wires: Wires) -> AbstractContextManager[Shutter]:
    """Return a shutter on a DAQ board, to be entered."""
    return DaqShutter(
        wires.daq(config.device),
        config.line,
        clock=wires.clock,
        opens_high=config.open_level == "high",
        moving_time_s=config.moving_time_s,
    )


def open_serial_shutter(config: SerialShutterConfig, wires: Wires) -> AbstractContextManager[Shutter]:
    """Return a shutter on a serial port, to be entered."""
    return SerialShutter(
        wires.shutter,
        clock=wires.clock,
        line=config.line,
        read_back=config.read_back,
        opens_high=config.open_level == "high",
        moving_time_s=config.moving_time_s,
    )


SHUTTERS: Kinds[Kind[Shutter]] = Kinds(
    "shutter", Kind(DaqShutterConfig, open_daq_shutter), Kind(SerialShutterConfig, open_serial_shutter)
)
