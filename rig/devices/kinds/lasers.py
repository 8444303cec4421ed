"""The kinds of lasers."""

from contextlib import AbstractContextManager

from drivers.katana.dialects import KATANA_05, KATANA_08HP
from drivers.katana.laser import KatanaLaser
from drivers.katana.settings import KatanaSettings
from drivers.nkt.laser import NktLaser
from drivers.nkt.settings import NktSettings
from rig.devices.by_hand import LaserByHand
from rig.devices.kinds.kind import Kind, Kinds
from rig.devices.kinds.wires import Wires
from rig.model.config import ExternalLaserConfig, Katana08Config, KatanaConfig, NktConfig
from rig.model.devices import Laser


def katana_settings(config: KatanaConfig) -> KatanaSettings:
    """Return how a Katana 05 is set, or raise `drivers.errors.LimitError`."""
    return KatanaSettings(
        model=KATANA_05,
        power=config.power_setpoint,
        repetition_hz=config.repetition_hz,
        trigger=config.trigger,
    )


def open_katana(config: KatanaConfig, wires: Wires) -> AbstractContextManager[Laser]:
    """Return a Katana 05, to be entered."""
    return KatanaLaser(wires.laser, clock=wires.clock, settings=katana_settings(config))


def katana_08hp_settings(config: Katana08Config) -> KatanaSettings:
    """Return how a Katana 08HP is set, or raise `drivers.errors.LimitError`."""
    return KatanaSettings(
        model=KATANA_08HP,
        power=config.power_w,
        repetition_hz=config.repetition_hz,
        trigger=config.trigger,
    )


def open_katana_08hp(config: Katana08Config, wires: Wires) -> AbstractContextManager[Laser]:
    """Return a Katana 08HP, to be entered."""
    return KatanaLaser(wires.laser, clock=wires.clock, settings=katana_08hp_settings(config))


def nkt_settings(config: NktConfig) -> NktSettings:
    """Return how a SuperK laser is set, or raise `drivers.errors.LimitError`."""
    return NktSettings(
        level_percent=config.level_percent,
        oscillator_hz=config.oscillator_hz,
        repetition_hz=config.repetition_hz,
    )


def open_nkt(config: NktConfig, wires: Wires) -> AbstractContextManager[Laser]:
    """Return a SuperK laser, to be entered."""
    return NktLaser(wires.laser, clock=wires.clock, settings=nkt_settings(config))


def open_external_laser(config: ExternalLaserConfig, wires: Wires) -> AbstractContextManager[Laser]:
    """Return a laser that a person switches, to be entered."""
    return LaserByHand(config.model)


LASERS: Kinds[Kind[Laser]] = Kinds(
    "laser",
    Kind(KatanaConfig, open_katana, katana_settings),
    Kind(Katana08Config, open_katana_08hp, katana_08hp_settings),
    Kind(NktConfig, open_nkt, nkt_settings),
    Kind(ExternalLaserConfig, open_external_laser),
)
