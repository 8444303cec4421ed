"""PicoQuant's timing instruments, each with the family of its section."""

from contextlib import AbstractContextManager
from typing import Any

from drivers.harp.device import Harp
from drivers.harp.families import (
    HYDRAHARP_400,
    HYDRAHARP_500,
    MULTIHARP,
    PICOHARP_330,
    TIMEHARP_260_N,
    TIMEHARP_260_P,
)
from drivers.harp.family import Family
from drivers.harp.settings import HarpSettings, Markers
from drivers.harp.stream import QUEUE_PIECES, HarpStream
from drivers.harp.triggers import CfdTrigger, EdgeTrigger, Trigger
from rig.devices.kinds.wires import Wires
from rig.model.config import (
    EitherTriggerConfig,
    HarpConfig,
    HydraHarp500Config,
    HydraHarpConfig,
    MultiHarpConfig,
    PicoHarp330Config,
    RigConfig,
    TimeHarp260Config,
)
from rig.model.devices import Tcspc, TimeTagger

#: After a marker, others at the same input are glitches; half of the shortest tick that a mirror can follow.
MARKER_HOLD_OFF_S = 20e-6
#: Pieces of 10 ms by which a simulated instrument may be ahead of the program where its clock jumps.
HURRIED_PIECES = 16
#: Of discriminators whose levels have their sign, where nobody says.
ZERO_CROSS_V = -0.01

_FAMILIES: dict[type[HarpConfig], Family] = {
    HydraHarpConfig: HYDRAHARP_400,
    MultiHarpConfig: MULTIHARP,
    PicoHarp330Config: PICOHARP_330,
    HydraHarp500Config: HYDRAHARP_500,
}


def family_of(harp: HarpConfig) -> Family:
    """Return what the driver knows of the instruments of a section."""
    if isinstance(harp, TimeHarp260Config):
        return TIMEHARP_260_P if harp.board == "P" else TIMEHARP_260_N
    return _FAMILIES[type(harp)]


def open_harp(config: RigConfig, wires: Wires, first: int) -> AbstractContextManager[Tcspc]:
    """Return the instrument, to be entered; it counts from any step on."""
    harp = _section(config)
    library = wires.harp(family_of(harp))
    return Harp(library, clock=wires.clock, serial=harp.serial, settings=harp_settings(config))


def open_harp_tagger(config: RigConfig, wires: Wires) -> AbstractContextManager[TimeTagger]:
    """Return the instrument in time-tagged mode, to be entered."""
    harp, simulation = _section(config), config.simulation
    # where the clock jumps, the instrument must not run ahead of the program by more than a look at the light
    hurried = simulation is not None and not simulation.real_time
    return HarpStream(
        wires.harp(family_of(harp)),
        clock=wires.clock,
        serial=harp.serial,
        settings=harp_settings(config),
        markers=Markers(hold_off_s=MARKER_HOLD_OFF_S),
        queue_pieces=HURRIED_PIECES if hurried else QUEUE_PIECES,
    )


def harp_settings(config: RigConfig) -> HarpSettings:
    """Return how the instrument is set, or raise `drivers.errors.LimitError`."""
    harp = _section(config)
    sync, inputs = _triggers(harp)
    return HarpSettings(
        family=family_of(harp),
        inputs=tuple(channel.input for channel in config.channels),
        sync_trigger=sync,
        input_trigger=inputs,
        sync_divider=harp.sync_divider,
        bin_width_s=harp.bin_width_s,
        bins=harp.bins,
        offset_s=harp.offset_s,
    )


def check_harp(config: RigConfig) -> None:
    """Raise `LimitError` unless the instrument can be set so, and take the laser's pulses."""
    settings = harp_settings(config)
    settings.family.limits.check_sync_rate(config.laser.repetition_hz, settings.sync_divider)


def check_harp_tagger(config: RigConfig) -> None:
    """Raise `LimitError` unless records of photons can hold what is configured."""
    settings = harp_settings(config)
    settings.family.limits.check_tagged(settings.bins, settings.inputs)


def _section(config: RigConfig) -> HarpConfig:
    assert isinstance(config.tcspc, HarpConfig)
    return config.tcspc


def _triggers(harp: HarpConfig) -> tuple[Trigger, Trigger]:
    """Return those of the sync and of the inputs."""
    if isinstance(harp, HydraHarpConfig):
        return (
            CfdTrigger(harp.sync_level_v, harp.sync_zero_cross_v),
            CfdTrigger(harp.input_level_v, harp.input_zero_cross_v),
        )
    assert isinstance(harp, MultiHarpConfig | EitherTriggerConfig)
    if isinstance(harp, EitherTriggerConfig) and harp.has_cfd:
        zero_cross_v = [
            ZERO_CROSS_V if one is None else one for one in (harp.sync_zero_cross_v, harp.input_zero_cross_v)
        ]
        return CfdTrigger(harp.sync_level_v, zero_cross_v[0]), CfdTrigger(harp.input_level_v, zero_cross_v[1])
    return _edge(harp.sync_level_v, harp.sync_edge), _edge(harp.input_level_v, harp.input_edge)


def _edge(level_v: float, edge: Any) -> EdgeTrigger:
    return EdgeTrigger(level_v, rising=edge == "rising")
