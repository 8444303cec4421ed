"""What a timing instrument can be set to, as data that needs neither instrument nor library.

Nothing is rounded or clipped silently: a value that does not fit is a `LimitError` that names the nearest.
The numbers are in `drivers.harp.families`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, log2

from drivers.errors import LimitError
from drivers.harp.triggers import CfdTrigger, Trigger, TriggerMode, WireTrigger

#: Relative difference below which two values are the same but for floating-point arithmetic.
SAME = 1e-6

#: Bins after a sync pulse, and inputs, that a time-tagged record can tell (T3, all families).
TAGGED_BINS, TAGGED_INPUTS = 32_768, 63

#: Length of a histogram with length code 0; each further code doubles it.
CODE_0_BINS = 1024


@dataclass(frozen=True)
class Steps:
    """The values that one setting takes: whole numbers of a unit from ``low`` to ``high``.

    Attributes
    ----------
    low, high
        The limits, in the unit.
    unit
        Its symbol.
    unit_si
        Its size in SI units.
    """

    low: int
    high: int
    unit: str
    unit_si: float

    def nearest(self, value: float) -> int:
        """Return the possible value that is nearest to ``value`` (SI), in the unit."""
        return round(min(max(self.low, value / self.unit_si), self.high))  # not-a-number becomes low

    def whole(self, device: str, what: str, value: float) -> int:
        """Return ``value`` (SI) in whole numbers of the unit.

        Raises
        ------
        LimitError
            If it is not whole, or outside the limits; it names the nearest possible value.
        """
        exact, nearest = value / self.unit_si, self.nearest(value)
        if not abs(exact - nearest) <= SAME * max(abs(nearest), 1):
            raise LimitError(
                device,
                f"set the {what} to {exact:.10g} {self.unit}",
                f"it accepts whole {self.unit} from {self.low} to {self.high}",
                f"The nearest possible value is {nearest} {self.unit}.",
            )
        return nearest


@dataclass(frozen=True)
class HarpLimits:
    """The limits of an instrument.

    Those of a family hold without an instrument. One that is open has its own, `Harp.limits`: its inputs,
    and its own base resolution.

    Attributes
    ----------
    device
        Whose limits these are, for messages.
    base_ps, binnings
        A bin is ``base_ps`` times a power of two wide, from ``2**0`` to ``2**(binnings - 1)``.
    max_bins, min_bins
        Length of the longest histogram, and of the shortest that is asked for: 1024 times powers of two.
    offset
        Left edge of the first bin after the sync pulse.
    marker_hold_off
        Time after a marker in which its input takes no other.
    sync_dividers
        By what the sync rate can be divided.
    most_sync_hz, most_divided_hz
        Highest sync rate, and highest after the divider; infinite where nobody says.
    cfd_level, zero_cross
        Of a discriminator; None where the inputs have none.
    edge_level
        Of an edge trigger; None where the inputs have none.
    inputs
        Number of photon inputs, beside the sync input; None where no instrument was asked: how many there
        are is the library's to say.
    exposure
        Of a measurement.
    cable_offset
        Shift of an input or the sync in time, in place of a longer or shorter cable.
    """

    device: str
    base_ps: float
    binnings: int
    max_bins: int
    offset: Steps
    marker_hold_off: Steps
    sync_dividers: tuple[int, ...]
    most_sync_hz: float
    most_divided_hz: float
    cfd_level: Steps | None = None
    zero_cross: Steps | None = None
    edge_level: Steps | None = None
    min_bins: int = CODE_0_BINS
    inputs: int | None = None
    exposure: Steps = Steps(1, 360_000_000, "ms", 1e-3)
    cable_offset: Steps = Steps(-99_999, 99_999, "ps", 1e-12)

    @property
    def has_both_triggers(self) -> bool:
        """Whether an input is told which of two triggers to use."""
        return self.cfd_level is not None and self.edge_level is not None

    def check_exposure(self, exposure_s: float) -> None:
        """Raise `LimitError` unless a measurement can be this long."""
        self.exposure_ms(exposure_s)

    def check_histogram(self, bins: int, bin_width_s: float) -> None:
        """Raise `LimitError` unless a histogram can have so many bins of this width."""
        self.length_code(bins)
        self.binning_code(bin_width_s)

    def check_tagged(self, bins: int, inputs: Sequence[int]) -> None:
        """Raise `LimitError` unless time-tagged records can tell so many bins, and these inputs."""
        if bins > TAGGED_BINS or max(inputs) >= TAGGED_INPUTS:
            raise LimitError(
                self.device,
                f"record photons of {bins} bins at inputs up to {max(inputs)}",
                f"records can number {TAGGED_BINS} bins at most, and inputs up to {TAGGED_INPUTS - 1}",
                "Use wider bins, or fewer inputs.",
            )

    def nearest_exposure_s(self, exposure_s: float) -> float:
        """Return the possible exposure that is nearest to ``exposure_s``."""
        return self.exposure.nearest(exposure_s) / 1000  # the nearest number to whole milliseconds

    def bin_width_covering(self, span_s: float, *, finest_s: float = 0.0) -> float:
        """Return the finest bin width with which the longest histogram covers ``span_s``.

        Parameters
        ----------
        span_s
            Time to cover.
        finest_s
            No finer than this.

        Raises
        ------
        LimitError
            If even the widest bins do not cover it.
        """
        needed_ps = max(span_s / self.max_bins, finest_s) * 1e12 * (1 - SAME)
        code = next((n for n in range(self.binnings) if self.base_ps * 2**n >= needed_ps), None)
        if code is None:
            widest_s = self.base_ps * 2 ** (self.binnings - 1) * 1e-12
            raise LimitError(
                self.device,
                f"cover {span_s:g} s in bins of at least {finest_s:g} s",
                f"it has {self.max_bins} bins of up to {widest_s:g} s",
                "Choose a shorter time.",
            )
        return self.base_ps * 2**code * 1e-12

    def exposure_ms(self, exposure_s: float) -> int:
        """Return an exposure in whole milliseconds, or raise `LimitError`."""
        return self.exposure.whole(self.device, "exposure", exposure_s)

    def binning_code(self, bin_width_s: float) -> int:
        """Return n for a bin width of ``base_ps * 2**n``.

        Raises
        ------
        LimitError
            If there is no such n; it names the nearest two bin widths.
        """
        base_ps, steps, width_ps = self.base_ps, self.binnings, bin_width_s * 1e12
        ideal = min(log2(width_ps / base_ps), steps) if width_ps > 0 else 0.0
        code = min(max(round(ideal), 0), steps - 1)
        if abs(base_ps * 2**code - width_ps) <= SAME * base_ps * 2**code:
            return code
        lower = min(max(floor(ideal), 0), steps - 2)
        raise LimitError(
            self.device,
            f"set the bin width to {width_ps:.10g} ps",
            f"it makes bins of {base_ps:g} ps times a power of two, up to {base_ps * 2 ** (steps - 1):g} ps",
            f"The nearest are {base_ps * 2**lower:g} ps and {base_ps * 2 ** (lower + 1):g} ps.",
        )

    def length_code(self, bins: int) -> int:
        """Return n of the shortest possible histogram, 1024 times 2**n, that holds ``bins`` bins.

        Raises
        ------
        LimitError
            If none does.
        """
        self._require_within("number of bins", bins, (1, self.max_bins))
        return ceil(log2(max(bins, self.min_bins) / CODE_0_BINS))

    def wire_trigger(self, what: str, trigger: Trigger) -> WireTrigger:
        """Return the trigger of an input in the library's units.

        Raises
        ------
        LimitError
            If the instrument has no such trigger, or it cannot be set so.
        """
        if isinstance(trigger, CfdTrigger):
            if self.cfd_level is None or self.zero_cross is None:
                raise self._no_trigger(what, "a constant-fraction discriminator", "edge triggers")
            level_mv = self.cfd_level.whole(self.device, f"{what} CFD level", trigger.level_v)
            zero_cross_mv = self.zero_cross.whole(
                self.device, f"{what} CFD zero crossing", trigger.zero_cross_v
            )
            return WireTrigger(TriggerMode.CFD, level_mv, zero_cross_mv)
        if self.edge_level is None:
            raise self._no_trigger(what, "an edge trigger", "constant-fraction discriminators")
        level_mv = self.edge_level.whole(self.device, f"{what} trigger level", trigger.level_v)
        return WireTrigger(TriggerMode.EDGE, level_mv, int(trigger.rising))

    def _no_trigger(self, what: str, asked: str, has: str) -> LimitError:
        return LimitError(
            self.device,
            f"give the {what} {asked}",
            f"its inputs have {has}",
            "Give only the settings that its inputs have.",
        )

    def check_inputs(self, inputs: Sequence[int]) -> None:
        """Raise `LimitError` unless these are different inputs, one at least, that the instrument has."""
        for channel in inputs:
            last = max(channel, 0) if self.inputs is None else self.inputs - 1
            self._require_within("input channel", channel, (0, last))
        if not inputs or len(set(inputs)) < len(inputs):
            raise LimitError(
                self.device,
                f"measure with the inputs {', '.join(map(str, inputs)) or 'none'}",
                "it needs one input or more, each given once",
                "Name different inputs.",
            )

    def check_sync_divider(self, divider: int) -> None:
        """Raise `LimitError` unless the sync can be divided by this."""
        if divider not in self.sync_dividers:
            *others, last = map(str, self.sync_dividers)
            raise LimitError(
                self.device,
                f"divide the sync by {divider}",
                f"it divides by {', '.join(others)} or {last}",
                "Choose one of these.",
            )

    def check_sync_rate(self, sync_hz: float, divider: int) -> None:
        """Raise `LimitError` unless sync pulses may come so often with this divider."""
        if sync_hz <= min(self.most_sync_hz, divider * self.most_divided_hz) * (1 + SAME):
            return  # also where nobody says how much it takes
        enough = [one for one in self.sync_dividers if sync_hz <= one * self.most_divided_hz * (1 + SAME)]
        possible = bool(enough) and sync_hz <= self.most_sync_hz * (1 + SAME)
        raise LimitError(
            self.device,
            f"time against {sync_hz / 1e6:g} MHz of sync pulses with a sync divider of {divider}",
            f"it accepts {self.most_divided_hz / 1e6:g} MHz after the divider, and "
            f"{self.most_sync_hz / 1e6:g} MHz before it",
            f"Set the sync divider to {enough[0]}." if possible else "Choose a slower laser rate.",
        )

    def _require_within(self, what: str, value: int, limits: tuple[int, int]) -> None:
        low, high = limits
        if value != int(value) or not low <= value <= high:
            raise LimitError(
                self.device,
                f"set the {what} to {value}",
                f"it accepts whole numbers from {low} to {high}",
                "Choose a value inside these limits.",
            )
