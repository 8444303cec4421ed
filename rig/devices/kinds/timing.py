"""The kinds of timing instruments."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

from drivers.hydraharp.device import HydraHarp
from drivers.hydraharp.limits import LIMITS as HYDRAHARP_LIMITS
from drivers.hydraharp.settings import HydraHarpSettings, Markers
from drivers.hydraharp.stream import QUEUE_PIECES, HydraHarpStream
from rig.devices.kinds.kind import Kinds
from rig.devices.kinds.wires import Wires
from rig.devices.playback import Playback
from rig.files.scan import ScanFile
from rig.model.config import HydraHarpConfig, PlaybackConfig, RigConfig, TcspcConfig
from rig.model.devices import Tcspc, TimeTagger

#: After a marker, others at the same input are glitches; half of the shortest tick that a mirror can follow.
MARKER_HOLD_OFF_S = 20e-6
#: Pieces of 10 ms by which a simulated instrument may be ahead of the program where its clock jumps.
HURRIED_PIECES = 16


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
    section
        Its section of the configuration.
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

    section: type[TcspcConfig]
    open: Callable[[RigConfig, Wires, int], AbstractContextManager[Tcspc]]
    open_tagger: Callable[[RigConfig, Wires], AbstractContextManager[TimeTagger]] | None
    limits: TimingLimits
    check: Callable[[RigConfig], None]
    time_axis: Callable[[Any], tuple[int, float]]


def open_hydraharp(config: RigConfig, wires: Wires, first: int) -> AbstractContextManager[Tcspc]:
    """Return the HydraHarp, to be entered; it counts from any step on."""
    return HydraHarp(wires.hhlib(), clock=wires.clock, **_harp(config))


def open_hydraharp_tagger(config: RigConfig, wires: Wires) -> AbstractContextManager[TimeTagger]:
    """Return the HydraHarp in time-tagged mode, to be entered."""
    simulation = config.simulation
    # where the clock jumps, the instrument must not run ahead of the program by more than a look at the light
    hurried = simulation is not None and not simulation.real_time
    return HydraHarpStream(
        wires.hhlib(),
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
        "settings": HydraHarpSettings(
            inputs=tuple(channel.input for channel in config.channels),
            input_level_v=harp.input_level_v,
            input_zero_cross_v=harp.input_zero_cross_v,
            sync_level_v=harp.sync_level_v,
            sync_zero_cross_v=harp.sync_zero_cross_v,
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
    HYDRAHARP_LIMITS.check_sync_rate(config.laser.repetition_hz, config.tcspc.sync_divider)


def open_playback(config: RigConfig, wires: Wires, first: int) -> AbstractContextManager[Tcspc]:
    """Return the player of a scan file, to be entered."""
    played = config.tcspc
    assert isinstance(played, PlaybackConfig)
    return Playback(played.file, channels=len(config.channels), clock=wires.clock, first=first)


def _axis_of_file(config: PlaybackConfig) -> tuple[int, float]:
    with ScanFile(config.file) as scan:
        return scan.bins, scan.bin_width_s


TIMING: Kinds[TimingKind] = Kinds(
    "tcspc",
    TimingKind(
        HydraHarpConfig,
        open_hydraharp,
        open_hydraharp_tagger,
        HYDRAHARP_LIMITS,
        check_hydraharp,
        lambda config: (config.bins, config.bin_width_s),
    ),
    TimingKind(PlaybackConfig, open_playback, None, AnyExposure(), lambda config: None, _axis_of_file),
)


def timing_limits(config: RigConfig) -> TimingLimits:
    """Return what the configured timing instrument can be asked for."""
    return TIMING.of(config.tcspc).limits


def time_axis(config: RigConfig) -> tuple[int, float]:
    """Return number and width of the bins that the configured timing instrument will have.

    Raises
    ------
    DataFileError
        If it plays a file that cannot be read.
    """
    return TIMING.of(config.tcspc).time_axis(config.tcspc)
