"""The kinds of detectors."""

from contextlib import AbstractContextManager

from drivers.id120 import Id120Settings, Id120Spad
from rig.devices.kinds.kind import Kind, Kinds
from rig.devices.kinds.wires import Wires
from rig.model.config import Id120Config
from rig.model.devices import GatedSpad


def open_id120(config: Id120Config, wires: Wires) -> AbstractContextManager[GatedSpad]:
    """Return the detector, to be entered."""
    return Id120Spad(
        serial=config.serial,
        backend=wires.usb_backend,
        clock=wires.clock,
        settings=Id120Settings(
            gated=config.gated,
            gate_delay_s=config.gate_delay_s,
            gate_width_s=config.gate_width_s,
            hold_off_s=config.hold_off_s,
            excess_bias_v=config.excess_bias_v,
        ),
    )


DETECTORS: Kinds[Kind[GatedSpad]] = Kinds("detector", Kind(Id120Config, open_id120))
