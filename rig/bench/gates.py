"""The simulated detector that a configuration describes, and the delayer of its gate."""

from functools import partial
from typing import TYPE_CHECKING

from rig.model.config import MpdConfig, PsdConfig, RigConfig, SimulationConfig

if TYPE_CHECKING:
    from collections.abc import Callable

    from simulators.bench import Bench
    from simulators.wire.lines import LineFirmware
    from simulators.wire.spad import DetectorInstrument


def detector_head(config: RigConfig) -> "Callable[[Bench], DetectorInstrument]":
    """Return what makes the simulated detector of the configured kind, on a bench."""
    from simulators.wire.mpd import MpdModule
    from simulators.wire.spad import SpadInstrument

    if not isinstance(config.detector, MpdConfig):
        return SpadInstrument
    set_by_hand = (config.simulation or SimulationConfig()).by_hand
    hold_off_s = config.detector.hold_off_s if set_by_hand.hold_off_s is None else set_by_hand.hold_off_s
    return partial(MpdModule, biased=set_by_hand.bias, hold_off_s=hold_off_s)


def gate_delayer(config: RigConfig) -> "Callable[[Bench], LineFirmware] | None":
    """Return what makes the simulated delayer, on a bench; None where there is none."""
    from simulators.wire.psd import PsdFirmware

    return PsdFirmware if isinstance(config.delayer, PsdConfig) else None
