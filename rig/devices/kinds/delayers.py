"""The kinds of gate delayers."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from drivers.delayers.dg645 import Dg645, Dg645Settings
from drivers.delayers.psd import Psd, PsdSettings
from drivers.delayers.t560 import T560, T560Settings
from rig.devices.by_hand import DelayerByHand
from rig.devices.kinds.kind import Kind, Kinds
from rig.devices.kinds.wires import Wires
from rig.model.config import DelayerConfig, Dg645Config, ExternalDelayerConfig, PsdConfig, T560Config
from rig.model.devices import GateDelayer


def psd_settings(config: PsdConfig, sync_hz: float) -> PsdSettings:
    """Return how a Picosecond Delayer is set, or raise `drivers.errors.LimitError`."""
    return PsdSettings(trigger_level_v=config.trigger_level_v, repetition_hz=sync_hz, divider=config.divider)


def open_psd(config: PsdConfig, wires: Wires) -> AbstractContextManager[GateDelayer]:
    """Return a Picosecond Delayer, to be entered."""
    return Psd(wires.delayer, clock=wires.clock, settings=psd_settings(config, wires.sync_hz))


def dg645_settings(config: Dg645Config, sync_hz: float) -> Dg645Settings:
    """Return how a DG645 is set, or raise `drivers.errors.LimitError`."""
    return Dg645Settings(
        output=config.output,
        pulse_width_s=config.pulse_width_s,
        amplitude_v=config.amplitude_v,
        polarity=config.polarity,
        trigger_edge=config.trigger_edge,
        trigger_level_v=config.trigger_level_v,
        repetition_hz=sync_hz,
        divider=config.divider,
    )


def open_dg645(config: Dg645Config, wires: Wires) -> AbstractContextManager[GateDelayer]:
    """Return a DG645, to be entered."""
    return Dg645(wires.delayer, settings=dg645_settings(config, wires.sync_hz))


def t560_settings(config: T560Config, sync_hz: float) -> T560Settings:
    """Return how a T560 is set, or raise `drivers.errors.LimitError`."""
    return T560Settings(
        output=config.output,
        pulse_width_s=config.pulse_width_s,
        polarity=config.polarity,
        trigger_edge=config.trigger_edge,
        trigger_level_v=config.trigger_level_v,
        repetition_hz=sync_hz,
        divider=config.divider,
    )


def open_t560(config: T560Config, wires: Wires) -> AbstractContextManager[GateDelayer]:
    """Return a T560, to be entered."""
    return T560(wires.delayer, settings=t560_settings(config, wires.sync_hz))


def open_external_delayer(config: ExternalDelayerConfig, wires: Wires) -> AbstractContextManager[GateDelayer]:
    """Return a delayer that a person sets, to be entered."""
    return DelayerByHand(config, wires.operator)


DELAYERS: Kinds[Kind[GateDelayer]] = Kinds(
    "delayer",
    Kind(PsdConfig, open_psd),
    Kind(Dg645Config, open_dg645),
    Kind(T560Config, open_t560),
    Kind(ExternalDelayerConfig, open_external_delayer),
)

#: How those are set whose limits depend on how fast they are triggered.
_TRIGGERED: dict[type[DelayerConfig], Callable[[Any, float], object]] = {
    PsdConfig: psd_settings,
    Dg645Config: dg645_settings,
    T560Config: t560_settings,
}


def check_trigger(section: DelayerConfig, sync_hz: float) -> None:
    """Raise `drivers.errors.LimitError` unless a delayer can be triggered so often."""
    if settings := _TRIGGERED.get(type(section)):
        settings(section, sync_hz)
