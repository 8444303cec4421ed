"""The simulated detector that a configuration describes, and the delayer of its gate."""

from functools import partial
from typing import TYPE_CHECKING

from rig.model.config import (
    DelayerConfig,
    Dg645Config,
    ExternalDetectorConfig,
    MpdConfig,
    PsdConfig,
    RigConfig,
    SimulationConfig,
    T560Config,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from simulators.bench import Bench
    from simulators.wire.lines import LineFirmware
    from simulators.wire.spad import DetectorInstrument


def detector_head(config: RigConfig) -> "Callable[[Bench], DetectorInstrument] | None":
    """Return what makes the simulated detector of the configured kind, on a bench; None without interface."""
    from simulators.wire.mpd import MpdModule
    from simulators.wire.spad import SpadInstrument

    if isinstance(config.detector, ExternalDetectorConfig):
        return None
    if not isinstance(config.detector, MpdConfig):
        return SpadInstrument
    set_by_hand = (config.simulation or SimulationConfig()).by_hand
    hold_off_s = config.detector.hold_off_s if set_by_hand.hold_off_s is None else set_by_hand.hold_off_s
    return partial(
        MpdModule,
        biased=set_by_hand.bias,
        hold_off_s=hold_off_s,
        error=set_by_hand.error,
        gate_delay_s=None if config.delayer else config.detector.gate_delay_s,
    )


def gate_delayer(config: RigConfig) -> "Callable[[Bench], LineFirmware] | None":
    """Return what makes the simulated delayer, on a bench; None without one, or without its interface."""
    from simulators.wire.dg645 import Dg645Box
    from simulators.wire.psd import PsdFirmware
    from simulators.wire.t560 import T560Box

    made: dict[type[DelayerConfig], Callable[[Bench], LineFirmware]] = {
        PsdConfig: PsdFirmware,
        Dg645Config: Dg645Box,
        T560Config: T560Box,
    }
    return made.get(type(config.delayer)) if config.delayer else None
