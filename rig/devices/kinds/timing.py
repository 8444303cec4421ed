"""The kinds of timing instruments."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

from rig.devices.kinds.harps import check_harp, check_harp_tagger, family_of, open_harp, open_harp_tagger
from rig.devices.kinds.kind import Kinds
from rig.devices.kinds.wires import Wires
from rig.devices.playback import Playback
from rig.files.records import RecordedBy
from rig.files.scan import ScanFile
from rig.model.config import (
    HarpConfig,
    HydraHarp500Config,
    HydraHarpConfig,
    MultiHarpConfig,
    PicoHarp330Config,
    PlaybackConfig,
    RigConfig,
    TcspcConfig,
    TimeHarp260Config,
)
from rig.model.devices import Tcspc, TimeTagger


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
class Tagging:
    """A timing instrument that records each photon.

    Attributes
    ----------
    open
        Of the configuration and the wires; gives the instrument, to be entered.
    check
        Raises `drivers.errors.LimitError` unless its records can hold what is configured.
    recorded_by
        Of the section: what files of its records call it.
    """

    open: Callable[[RigConfig, Wires], AbstractContextManager[TimeTagger]]
    check: Callable[[RigConfig], None]
    recorded_by: Callable[[Any], RecordedBy]


@dataclass(frozen=True)
class TimingKind:
    """A kind of timing instrument.

    Attributes
    ----------
    section
        Its section of the configuration.
    open
        Of the configuration, the wires, and the step of the plan with which it begins.
    tagging
        The same instrument, recording each photon; None where it cannot.
    limits
        Of the section: what it can be asked for.
    check
        Raises `drivers.errors.LimitError` unless it can be set as configured, and take the laser's pulses.
    time_axis
        Number and width of the bins that it will have, as far as that is known without it.
    """

    section: type[TcspcConfig]
    open: Callable[[RigConfig, Wires, int], AbstractContextManager[Tcspc]]
    tagging: Tagging | None
    limits: Callable[[Any], TimingLimits]
    check: Callable[[RigConfig], None]
    time_axis: Callable[[Any], tuple[int, float]]


def _harp_kind(section: type[HarpConfig]) -> TimingKind:
    return TimingKind(
        section,
        open_harp,
        Tagging(open_harp_tagger, check_harp_tagger, _recorded_by),
        lambda config: family_of(config).limits,
        check_harp,
        lambda config: (config.bins, config.bin_width_s),
    )


def _recorded_by(config: HarpConfig) -> RecordedBy:
    family = family_of(config)
    return RecordedBy(family.hardware, family.record_type, family.limits.base_ps * 1e-12)


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
    _harp_kind(HydraHarpConfig),
    _harp_kind(MultiHarpConfig),
    _harp_kind(PicoHarp330Config),
    _harp_kind(TimeHarp260Config),
    _harp_kind(HydraHarp500Config),
    TimingKind(
        PlaybackConfig,
        open_playback,
        None,
        lambda config: AnyExposure(),
        lambda config: None,
        _axis_of_file,
    ),
)


def timing_limits(config: RigConfig) -> TimingLimits:
    """Return what the configured timing instrument can be asked for."""
    return TIMING.of(config.tcspc).limits(config.tcspc)


def time_axis(config: RigConfig) -> tuple[int, float]:
    """Return number and width of the bins that the configured timing instrument will have.

    Raises
    ------
    DataFileError
        If it plays a file that cannot be read.
    """
    return TIMING.of(config.tcspc).time_axis(config.tcspc)
