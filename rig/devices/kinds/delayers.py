"""The kinds of gate delayers."""

from contextlib import AbstractContextManager

from drivers.delayers.psd import PsdDelayer, PsdSettings
from rig.devices.kinds.kind import Kind, Kinds
from rig.devices.kinds.wires import Wires
from rig.model.config import PsdConfig
from rig.model.devices import GateDelayer


def open_psd(config: PsdConfig, wires: Wires) -> AbstractContextManager[GateDelayer]:
    """Return a Picosecond Delayer, to be entered."""
    settings = PsdSettings(trigger_level_v=config.trigger_level_v, repetition_hz=wires.sync_hz)
    return PsdDelayer(wires.delayer, clock=wires.clock, settings=settings)


DELAYERS: Kinds[Kind[GateDelayer]] = Kinds("delayer", Kind(PsdConfig, open_psd))
