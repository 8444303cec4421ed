"""The kinds of devices: for each role a table from the kind that a configuration names to what opens it.

A new device of a known role costs its driver, its simulator at the wire, its section in `rig.model.config`,
and a line here.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

from drivers.daq.analogue_galvo import AnalogueGalvo, AnalogueLimits, Settling
from drivers.daq.board import SharedBoard
from drivers.daq.point_clock import DaqPointClock, PulseLines
from drivers.harp.device import Harp
from drivers.harp.families import HYDRAHARP_400
from drivers.harp.library import HarpLibrary
from drivers.harp.settings import HarpSettings, Markers
from drivers.harp.stream import QUEUE_PIECES, HarpStream
from drivers.harp.triggers import CfdTrigger
from drivers.id120 import Id120Settings, Id120Spad
from drivers.katana.dialects import KATANA_05, KATANA_08HP
from drivers.katana.laser import KatanaLaser
from drivers.katana.settings import KatanaSettings
from drivers.nkt.laser import NktLaser
from drivers.nkt.settings import NktSettings
from drivers.optotune import OptotuneLimits, OptotuneMirror
from rig.devices.playback import Playback
from rig.files.scan import ScanFile
from rig.model.config import (
    AnalogueGalvoConfig,
    DaqClockConfig,
    HydraHarpConfig,
    Id120Config,
    Katana08Config,
    KatanaConfig,
    NktConfig,
    OptotuneConfig,
    PlaybackConfig,
    RigConfig,
)
from rig.model.devices import Clock, Galvo, GatedSpad, Laser, PointClock, Tcspc, TimeTagger

#: After a marker, others at the same input are glitches; half of the shortest tick that a mirror can follow.
MARKER_HOLD_OFF_S = 20e-6
#: Pieces of 10 ms by which a simulated instrument may be ahead of the program where its clock jumps.
HURRIED_PIECES = 16


@dataclass(frozen=True)
class Wires:
    """Where each driver finds its device.

    Attributes
    ----------
    galvo, laser
        Serial ports or pyserial URLs.
    usb_backend
        Of pyusb; None for the system's.
    harp
        Gives the timing instrument's library, when it is needed.
    daq
        Gives the DAQ board of a name: always the same one, so that all devices on it share it.
    clock
        The time that all devices share.
    """

    galvo: str
    laser: str
    usb_backend: object
    harp: Callable[[], HarpLibrary]
    daq: Callable[[str], SharedBoard]
    clock: Clock


class TimingLimits(Protocol):
    """What a timing instrument can be asked for, known without it."""

    def check_exposure(self, exposure_s: float) -> None:
        """Raise `drivers.errors.LimitError` unless an exposure is possible."""
        ...

    def check_histogram(self, bins: int, bin_width_s: float) -> None:
        """Raise `drivers.errors.LimitError` unless a histogram can have so many bins of this width."""
        ...


class AnyExposure:
    """The limits of an instrument that has none."""

    def check_exposure(self, exposure_s: float) -> None:
        """Allow every exposure."""

    def check_histogram(self, bins: int, bin_width_s: float) -> None:
        """Allow every histogram."""


@dataclass(frozen=True)
class TimingKind:
    """A kind of timing instrument.

    Attributes
    ----------
    open
        Of the configuration, the wires, and the step of the plan with which it begins.
    open_tagger
        The same instrument, recording each photon; None where it cannot.
    limits
        What it can be asked for.
    check
        Raises `drivers.errors.LimitError` unless it can be set as configured, and take the laser's pulses.
    time_axis
        Number and width of the bins that it will have, as far as that is known without it.
    """

    open: Callable[[RigConfig, Wires, int], AbstractContextManager[Tcspc]]
    open_tagger: Callable[[RigConfig, Wires], AbstractContextManager[TimeTagger]] | None
    limits: TimingLimits
    check: Callable[[RigConfig], None]
    time_axis: Callable[[Any], tuple[int, float]]


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


def open_katana(config: KatanaConfig, wires: Wires) -> AbstractContextManager[Laser]:
    """Return a Katana 05, to be entered."""
    return KatanaLaser(wires.laser, clock=wires.clock, settings=katana_settings(config))


def katana_settings(config: KatanaConfig) -> KatanaSettings:
    """Return how a Katana 05 is set, or raise `drivers.errors.LimitError`."""
    return KatanaSettings(
        model=KATANA_05,
        power=config.power_setpoint,
        repetition_hz=config.repetition_hz,
        trigger=config.trigger,
    )


def open_katana_08hp(config: Katana08Config, wires: Wires) -> AbstractContextManager[Laser]:
    """Return a Katana 08HP, to be entered."""
    return KatanaLaser(wires.laser, clock=wires.clock, settings=katana_08hp_settings(config))


def katana_08hp_settings(config: Katana08Config) -> KatanaSettings:
    """Return how a Katana 08HP is set, or raise `drivers.errors.LimitError`."""
    return KatanaSettings(
        model=KATANA_08HP,
        power=config.power_w,
        repetition_hz=config.repetition_hz,
        trigger=config.trigger,
    )


def open_nkt(config: NktConfig, wires: Wires) -> AbstractContextManager[Laser]:
    """Return a SuperK laser, to be entered."""
    return NktLaser(wires.laser, clock=wires.clock, settings=nkt_settings(config))


def nkt_settings(config: NktConfig) -> NktSettings:
    """Return how a SuperK laser is set, or raise `drivers.errors.LimitError`."""
    return NktSettings(
        level_percent=config.level_percent,
        oscillator_hz=config.oscillator_hz,
        repetition_hz=config.repetition_hz,
    )


def open_hydraharp(config: RigConfig, wires: Wires, first: int) -> AbstractContextManager[Tcspc]:
    """Return the HydraHarp, to be entered; it counts from any step on."""
    return Harp(wires.harp(), clock=wires.clock, **_harp(config))


def open_hydraharp_tagger(config: RigConfig, wires: Wires) -> AbstractContextManager[TimeTagger]:
    """Return the HydraHarp in time-tagged mode, to be entered."""
    simulation = config.simulation
    # where the clock jumps, the instrument must not run ahead of the program by more than a look at the light
    hurried = simulation is not None and not simulation.real_time
    return HarpStream(
        wires.harp(),
        clock=wires.clock,
        markers=Markers(hold_off_s=MARKER_HOLD_OFF_S),
        queue_pieces=HURRIED_PIECES if hurried else QUEUE_PIECES,
        **_harp(config),
    )


def _harp(config: RigConfig) -> dict[str, Any]:
    harp = config.tcspc
    assert isinstance(harp, HydraHarpConfig)
    return {
        "serial": harp.serial,
        "settings": HarpSettings(
            family=HYDRAHARP_400,
            inputs=tuple(channel.input for channel in config.channels),
            input_trigger=CfdTrigger(harp.input_level_v, harp.input_zero_cross_v),
            sync_trigger=CfdTrigger(harp.sync_level_v, harp.sync_zero_cross_v),
            sync_divider=harp.sync_divider,
            bin_width_s=harp.bin_width_s,
            bins=harp.bins,
            offset_s=harp.offset_s,
        ),
    }


def check_hydraharp(config: RigConfig) -> None:
    """Raise `LimitError` unless a HydraHarp can be set so, and take the laser's pulses."""
    assert isinstance(config.tcspc, HydraHarpConfig)
    _harp(config)
    HYDRAHARP_400.limits.check_sync_rate(config.laser.repetition_hz, config.tcspc.sync_divider)


def open_daq_clock(config: DaqClockConfig, wires: Wires) -> AbstractContextManager[PointClock]:
    """Return the point clock, to be entered."""
    return DaqPointClock(wires.daq(config.device), PulseLines(config.markers, config.step or None))


def open_playback(config: RigConfig, wires: Wires, first: int) -> AbstractContextManager[Tcspc]:
    """Return the player of a scan file, to be entered."""
    played = config.tcspc
    assert isinstance(played, PlaybackConfig)
    return Playback(played.file, channels=len(config.channels), clock=wires.clock, first=first)


def _axis_of_file(config: PlaybackConfig) -> tuple[int, float]:
    with ScanFile(config.file) as scan:
        return scan.bins, scan.bin_width_s


GALVOS: dict[str, Callable[[Any, Wires], AbstractContextManager[Galvo]]] = {
    "optotune": open_optotune,
    "analogue": open_analogue_galvo,
}
LASERS: dict[str, Callable[[Any, Wires], AbstractContextManager[Laser]]] = {
    "katana": open_katana,
    "katana-08hp": open_katana_08hp,
    "nkt": open_nkt,
}
#: How a laser of each kind is set, or `drivers.errors.LimitError` where it cannot be set so.
LASER_SETTINGS: dict[str, Callable[[Any], object]] = {
    "katana": katana_settings,
    "katana-08hp": katana_08hp_settings,
    "nkt": nkt_settings,
}
DETECTORS: dict[str, Callable[[Any, Wires], AbstractContextManager[GatedSpad]]] = {"id120": open_id120}
POINT_CLOCKS: dict[str, Callable[[Any, Wires], AbstractContextManager[PointClock]]] = {"daq": open_daq_clock}
TIMING: dict[str, TimingKind] = {
    "hydraharp": TimingKind(
        open_hydraharp,
        open_hydraharp_tagger,
        HYDRAHARP_400.limits,
        check_hydraharp,
        lambda config: (config.bins, config.bin_width_s),
    ),
    "playback": TimingKind(open_playback, None, AnyExposure(), lambda config: None, _axis_of_file),
}


def check_settings(config: RigConfig) -> None:
    """Raise `drivers.errors.LimitError` unless laser and timing instrument can be set as configured."""
    LASER_SETTINGS[config.laser.kind](config.laser)
    TIMING[config.tcspc.kind].check(config)


def timing_limits(config: RigConfig) -> TimingLimits:
    """Return what the configured timing instrument can be asked for."""
    return TIMING[config.tcspc.kind].limits


def time_axis(config: RigConfig) -> tuple[int, float]:
    """Return number and width of the bins that the configured timing instrument will have.

    Raises
    ------
    DataFileError
        If it plays a file that cannot be read.
    """
    return TIMING[config.tcspc.kind].time_axis(config.tcspc)
