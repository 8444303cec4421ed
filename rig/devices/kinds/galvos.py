"""The kinds of beam-steering mirrors."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

from drivers.daq.analogue_galvo import AnalogueGalvo, AnalogueLimits, Settling
from drivers.optotune import OptotuneLimits, OptotuneMirror
from rig.devices.kinds.kind import Kind, Kinds
from rig.devices.kinds.wires import Wires
from rig.model.config import AnalogueGalvoConfig, GalvoConfig, OptotuneConfig
from rig.model.devices import Galvo


def open_optotune(config: OptotuneConfig, wires: Wires) -> AbstractContextManager[Galvo]:
    """Return the steering mirror, to be entered."""
    limits = OptotuneLimits((config.max_angle_x_rad, config.max_angle_y_rad))
    return OptotuneMirror(wires.galvo, clock=wires.clock, limits=limits, expected_identity=config.serial)


def open_analogue_galvo(config: AnalogueGalvoConfig, wires: Wires) -> AbstractContextManager[Galvo]:
    """Return the galvanometer pair, to be entered."""
    return AnalogueGalvo(
        wires.daq(config.device),
        config.channels,
        clock=wires.clock,
        limits=AnalogueLimits((config.max_angle_x_rad, config.max_angle_y_rad), config.volts_per_degree),
        settling=Settling(config.settle_time_s, config.settle_time_full_s),
    )


GALVOS: Kinds[Kind[Galvo]] = Kinds(
    "galvo",
    Kind(OptotuneConfig, open_optotune),
    Kind(AnalogueGalvoConfig, open_analogue_galvo),
)


@dataclass(frozen=True)
class Loading:
    """How a mirror is told its way before it goes it, known without it.

    Attributes
    ----------
    longest
        How many positions it can be told at once; None where that does not matter, or is not known.
    duration_s
        Estimates how long telling so many takes.
    """

    longest: int | None = None
    duration_s: Callable[[int], float] = lambda positions: 0.0


def loading(section: GalvoConfig) -> Loading:
    """Return how a mirror is told its way."""
    if not isinstance(section, OptotuneConfig):
        return Loading()
    limits = OptotuneLimits()
    return Loading(limits.longest_trajectory, limits.loading_s)
