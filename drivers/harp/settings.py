"""The settings of the HydraHarp's histogram mode: in SI units, and as the instrument's own integers."""

from dataclasses import dataclass

from drivers.errors import LimitError
from drivers.harp.limits import LIMITS, HydraHarpLimits


@dataclass(frozen=True)
class Integers:
    """A `HydraHarpSettings` in the units and codes of the vendor's library.

    Attributes
    ----------
    sync_cfd_mv, input_cfd_mv
        Level and zero crossing.
    input_offsets_ps
        One for each input in use.
    """

    sync_cfd_mv: tuple[int, int]
    sync_offset_ps: int
    input_cfd_mv: tuple[int, int]
    input_offsets_ps: tuple[int, ...]
    binning: int
    length: int
    offset_ns: int


@dataclass(frozen=True, kw_only=True)
class HydraHarpSettings:
    """Everything that is set once, checked when it is made: no instrument is needed to be refused.

    Attributes
    ----------
    inputs
        The photon inputs to measure with, counted from 0; the front panel counts from 1. All others are
        switched off. Counts come in this order.
    input_level_v, input_zero_cross_v, sync_level_v, sync_zero_cross_v
        Discriminator level (0 to 1 V) and zero crossing (0 to 40 mV), whole millivolts, both positive though
        the signals are negative. The defaults suit no detector in particular.
    input_offsets_s, sync_offset_s
        Shifts in time in whole picoseconds up to 99.999 ns, in place of longer or shorter cables: one for
        each of ``inputs``, or none at all.
    sync_divider
        1, 2, 4, 8 or 16; the divided sync rate may be up to 12.5 MHz (manual).
    bin_width_s
        The base resolution (1 ps) times a power of two.
    bins
        Number of bins that a measurement returns.
    offset_s
        Left edge of the first bin in whole nanoseconds, 0 to 500 us.
    external_reference
        Take the 10 MHz reference from the external input.

    Raises
    ------
    LimitError
        If a setting is outside what any HydraHarp can do.
    """

    inputs: tuple[int, ...] = (0,)
    input_level_v: float = 0.05
    input_zero_cross_v: float = 0.01
    input_offsets_s: tuple[float, ...] = ()
    sync_level_v: float = 0.05
    sync_zero_cross_v: float = 0.01
    sync_offset_s: float = 0.0
    sync_divider: int = 1
    bin_width_s: float = 4e-12
    bins: int = 15000
    offset_s: float = 0.0
    external_reference: bool = False

    def __post_init__(self) -> None:
        self.integers(LIMITS)

    def integers(self, limits: HydraHarpLimits) -> Integers:
        """Return the settings as the library takes them.

        Raises
        ------
        LimitError
            If one of them is outside ``limits``.
        """
        device, level, zero_cross = limits.device, limits.level, limits.zero_cross
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
            sync_cfd_mv=(
                level.whole(device, "sync CFD level", self.sync_level_v),
                zero_cross.whole(device, "sync CFD zero crossing", self.sync_zero_cross_v),
            ),
            sync_offset_ps=limits.cable_offset.whole(device, "sync offset", self.sync_offset_s),
            input_cfd_mv=(
                level.whole(device, "input CFD level", self.input_level_v),
                zero_cross.whole(device, "input CFD zero crossing", self.input_zero_cross_v),
            ),
            input_offsets_ps=tuple(
                limits.cable_offset.whole(device, "input offset", offset_s) for offset_s in self._offsets_s
            ),
            binning=limits.binning_code(self.bin_width_s),
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
            "sync_level_v": self.sync_level_v,
            "sync_zero_cross_v": self.sync_zero_cross_v,
            "sync_offset_s": self.sync_offset_s,
            "inputs": ", ".join(map(str, self.inputs)),
            "input_level_v": self.input_level_v,
            "input_zero_cross_v": self.input_zero_cross_v,
            **{f"input_{n}_offset_s": one for n, one in offsets_s},
            "bin_width_s": self.bin_width_s,
            "bins": self.bins,
            "offset_s": self.offset_s,
        }


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
        Time after a marker in which no other is taken, in whole nanoseconds up to 524.296 us: against
        glitches of long cables.

    Raises
    ------
    LimitError
        If the hold-off is outside what any HydraHarp can do.
    """

    enabled: tuple[bool, bool, bool, bool] = (True, True, True, True)
    rising: tuple[bool, bool, bool, bool] = (True, True, True, True)
    hold_off_s: float = 0.0

    def __post_init__(self) -> None:
        self.hold_off_ns(LIMITS)

    def hold_off_ns(self, limits: HydraHarpLimits) -> int:
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
