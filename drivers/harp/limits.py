"""What a HydraHarp 400 can be set to, as data that needs neither instrument nor library.

Nothing is rounded or clipped silently: a value that does not fit is a `LimitError` that names the nearest.
Source of the numbers, where nothing else is said: the vendor's hhdefin.h, version 3.0.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, log2

from drivers.errors import LimitError

#: Relative difference below which two values are the same but for floating-point arithmetic.
SAME = 1e-6

#: The longest histogram, and the shortest; those between are the shortest times a power of two.
MAX_BINS = 65536
MIN_BINS = 1024


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
                f"it takes whole {self.unit} from {self.low} to {self.high}",
                f"The nearest possible value is {nearest} {self.unit}.",
            )
        return nearest


@dataclass(frozen=True)
class HydraHarpLimits:
    """The limits of the instrument.

    The defaults hold without an instrument. One that is open has its own, `HydraHarp.limits`: its inputs,
    and its own base resolution.

    Attributes
    ----------
    device
        Whose limits these are, for messages.
    inputs
        Number of photon inputs, beside the sync input; None where no instrument was asked. The header knows 8
        (MAXINPCHAN), but how many there are is the library's to say.
    base_ps, binnings
        A bin is ``base_ps`` times a power of two wide, from ``2**0`` to ``2**(binnings - 1)`` (1 ps: manual).
    max_bins
        Length of the longest histogram.
    exposure, offset
        Of a measurement; left edge of the first bin after the sync pulse. (The header's comment on the lower
        limit of the offset says ps; the function takes nanoseconds.)
    cable_offset
        Shift of an input or the sync in time, in place of a longer or shorter cable.
    level, zero_cross
        Of a discriminator; both positive, though the signals are negative.
    sync_dividers
        By what the sync rate can be divided.
    most_sync_hz, most_divided_hz
        Highest sync rate, and highest after the divider (manual).
    marker_hold_off
        Time after a marker in which its input takes no other. The instrument counts it in steps of about 8 ns
        (header); how it rounds is unconfirmed.
    """

    device: str = "HydraHarp"
    inputs: int | None = None
    base_ps: float = 1.0
    binnings: int = 26
    max_bins: int = MAX_BINS
    exposure: Steps = Steps(1, 360_000_000, "ms", 1e-3)
    offset: Steps = Steps(0, 500_000, "ns", 1e-9)
    cable_offset: Steps = Steps(-99_999, 99_999, "ps", 1e-12)
    level: Steps = Steps(0, 1000, "mV", 1e-3)
    zero_cross: Steps = Steps(0, 40, "mV", 1e-3)
    sync_dividers: tuple[int, ...] = (1, 2, 4, 8, 16)
    most_sync_hz: float = 150e6
    most_divided_hz: float = 12.5e6
    marker_hold_off: Steps = Steps(0, 524_296, "ns", 1e-9)

    def check_exposure(self, exposure_s: float) -> None:
        """Raise `LimitError` unless a measurement can be this long."""
        self.exposure_ms(exposure_s)

    def check_histogram(self, bins: int, bin_width_s: float) -> None:
        """Raise `LimitError` unless a histogram can have so many bins of this width."""
        self.length_code(bins)
        self.binning_code(bin_width_s)

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
        """Return n of the shortest histogram, 1024 times 2**n, that holds ``bins`` bins.

        Raises
        ------
        LimitError
            If none does.
        """
        self._require_within("number of bins", bins, (1, self.max_bins))
        return ceil(log2(max(bins, MIN_BINS) / MIN_BINS))

    def check_inputs(self, inputs: Sequence[int]) -> None:
        """Raise `LimitError` unless these are different inputs, one at least, that the instrument has."""
        for channel in inputs:
            last = max(channel, 0) if self.inputs is None else self.inputs - 1
            self._require_within("input channel", channel, (0, last))
        if not inputs or len(set(inputs)) < len(inputs):
            raise LimitError(
                self.device,
                f"measure with the inputs {', '.join(map(str, inputs)) or 'none'}",
                "it takes one input or more, each once",
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
            return
        enough = [one for one in self.sync_dividers if sync_hz <= one * self.most_divided_hz * (1 + SAME)]
        possible = bool(enough) and sync_hz <= self.most_sync_hz * (1 + SAME)
        raise LimitError(
            self.device,
            f"time against {sync_hz / 1e6:g} MHz of sync pulses with a sync divider of {divider}",
            f"it takes {self.most_divided_hz / 1e6:g} MHz after the divider, and "
            f"{self.most_sync_hz / 1e6:g} MHz before it",
            f"Set the sync divider to {enough[0]}." if possible else "Choose a slower laser rate.",
        )

    def _require_within(self, what: str, value: int, limits: tuple[int, int]) -> None:
        low, high = limits
        if value != int(value) or not low <= value <= high:
            raise LimitError(
                self.device,
                f"set the {what} to {value}",
                f"it takes whole numbers from {low} to {high}",
                "Choose a value inside these limits.",
            )


#: What holds for every HydraHarp 400, and can be asked without one.
LIMITS = HydraHarpLimits()
