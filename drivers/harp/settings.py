"""The settings of a timing instrument: in SI units, and as the instrument's own integers."""

from dataclasses import dataclass

from drivers.errors import LimitError
from drivers.harp.family import Family
from drivers.harp.limits import HarpLimits
from drivers.harp.triggers import CfdTrigger, Trigger, WireTrigger


@dataclass(frozen=True)
class Integers:
    """`HarpSettings` in the units and codes of the vendor's library.

    Attributes
    ----------
    input_offsets_ps
        One for each input in use.
    """

    sync_trigger: WireTrigger
    sync_offset_ps: int
    input_trigger: WireTrigger
    input_offsets_ps: tuple[int, ...]
    binning: int
    length: int
    offset_ns: int


@dataclass(frozen=True, kw_only=True)
class HarpSettings:
    """Everything that is set once, checked when it is made: no instrument is needed to be refused.

    Attributes
    ----------
    family
        What kind of instrument it is for.
    inputs
        The photon inputs to measure with, counted from 0; the front panel counts from 1. All others are
        switched off. Counts come in this order.
    sync_trigger, input_trigger
        How the inputs make events of pulses; None: as is usual for the family, which suits no detector in
        particular.
    input_offsets_s, sync_offset_s
        Shifts in time in whole picoseconds up to 99.999 ns, in place of longer or shorter cables: one for
        each of ``inputs``, or none at all.
    sync_divider
        By what the sync rate is divided.
    bin_width_s
        The base resolution times a power of two; None: as is usual for the family.
    bins
        Number of bins that a measurement returns.
    offset_s
        Left edge of the first bin in whole nanoseconds.
    external_reference
        Take the 10 MHz reference from the external input.

    Raises
    ------
    LimitError
        If a setting is outside what any instrument of the family can do.
    """

    family: Family
    inputs: tuple[int, ...] = (0,)
    sync_trigger: Trigger | None = None
    input_trigger: Trigger | None = None
    input_offsets_s: tuple[float, ...] = ()
    sync_offset_s: float = 0.0
    sync_divider: int = 1
    bin_width_s: float | None = None
    bins: int = 15000
    offset_s: float = 0.0
    external_reference: bool = False

    def __post_init__(self) -> None:
        self.integers(self.family.limits)
        if self.external_reference and not self.family.takes_reference:
            raise LimitError(
                self.family.name,
                "use an external reference clock",
                "its library has no function for this",
                "Use the internal one.",
            )

    @property
    def width_s(self) -> float:
        """The bin width that is asked for."""
        return self.family.bin_width_s if self.bin_width_s is None else self.bin_width_s

    def integers(self, limits: HarpLimits) -> Integers:
        """Return the settings as the library takes them.

        Raises
        ------
        LimitError
            If one of them is outside ``limits``.
        """
        device, shift, usual = limits.device, limits.cable_offset, self.family.trigger
        limits.check_inputs(self.inputs)
        limits.check_sync_divider(self.sync_divider)
        if len(self._offsets_s) != len(self.inputs):
            raise LimitError(
                device,
                f"shift {len(self.inputs)} inputs in time",
                f"{len(self._offsets_s)} offsets were given",
                "Give one offset for each input, or none.",
            )
        return Integers(
            sync_trigger=limits.wire_trigger("sync", self.sync_trigger or usual),
            sync_offset_ps=shift.whole(device, "sync offset", self.sync_offset_s),
            input_trigger=limits.wire_trigger("input", self.input_trigger or usual),
            input_offsets_ps=tuple(shift.whole(device, "input offset", one) for one in self._offsets_s),
            binning=limits.binning_code(self.width_s),
            length=limits.length_code(self.bins),
            offset_ns=limits.offset.whole(device, "histogram offset", self.offset_s),
        )

    @property
    def _offsets_s(self) -> tuple[float, ...]:
        return self.input_offsets_s or (0.0,) * len(self.inputs)

    def as_dict(self) -> dict[str, str | int | float | bool]:
        """Return the settings in SI units; the inputs as text, e.g. ``"0, 2"``, and an offset for each."""
        offsets_s = zip(self.inputs, self._offsets_s, strict=True)
        return {
            "mode": "histogram",
            "reference": "external" if self.external_reference else "internal",
            "sync_divider": self.sync_divider,
            **_told("sync", self.sync_trigger or self.family.trigger),
            "sync_offset_s": self.sync_offset_s,
            "inputs": ", ".join(map(str, self.inputs)),
            **_told("input", self.input_trigger or self.family.trigger),
            **{f"input_{n}_offset_s": one for n, one in offsets_s},
            "bin_width_s": self.width_s,
            "bins": self.bins,
            "offset_s": self.offset_s,
        }


def _told(what: str, trigger: Trigger) -> dict[str, str | float]:
    """Return a trigger in SI units."""
    if isinstance(trigger, CfdTrigger):
        return {f"{what}_level_v": trigger.level_v, f"{what}_zero_cross_v": trigger.zero_cross_v}
    return {f"{what}_level_v": trigger.level_v, f"{what}_edge": "rising" if trigger.rising else "falling"}


@dataclass(frozen=True)
class Markers:
    """The four marker inputs M1 to M4 in time-tagged mode.

    Attributes
    ----------
    enabled
        Which of them make records.
    rising
        Which of them do so at the rising edge; the others at the falling one.
    hold_off_s
        Time after a marker in which no other is taken, in whole nanoseconds: against glitches of long
        cables.
    """

    enabled: tuple[bool, bool, bool, bool] = (True, True, True, True)
    rising: tuple[bool, bool, bool, bool] = (True, True, True, True)
    hold_off_s: float = 0.0

    def hold_off_ns(self, limits: HarpLimits) -> int:
        """Return the hold-off as the library takes it, or raise `LimitError`."""
        return limits.marker_hold_off.whole(limits.device, "marker hold-off", self.hold_off_s)

    def as_dict(self) -> dict[str, str | int | float | bool]:
        """Return the settings in SI units; the inputs as text, e.g. ``"M1, M3"``."""
        names = [f"M{n}" for n in range(1, 5)]
        rising = [name for name, on in zip(names, self.rising, strict=True) if on]
        enabled = [name for name, on in zip(names, self.enabled, strict=True) if on]
        return {
            "markers": ", ".join(enabled),
            "markers_at_rising_edge": ", ".join(rising),
            "marker_hold_off_s": self.hold_off_s,
        }
