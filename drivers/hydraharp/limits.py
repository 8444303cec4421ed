"""From SI quantities to the instrument's integers, refused where the instrument could not do them exactly.

Nothing is rounded or clipped silently: a value that does not fit is a `LimitError` that names the nearest.
"""

from math import ceil, floor, log2

from drivers.errors import LimitError
from drivers.hydraharp.constants import MAX_HISTOGRAM_BINS, SHORTEST_HISTOGRAM_BINS

#: Relative difference below which two times are the same but for floating-point arithmetic.
SAME = 1e-6


def whole(device: str, what: str, value_s: float, unit_s: float, unit: str, limits: tuple[int, int]) -> int:
    """Return ``value_s`` as a whole number of ``unit_s`` within ``limits``.

    Raises
    ------
    LimitError
        If it is not whole, or outside the limits; it names the nearest possible value.
    """
    low, high = limits
    exact = value_s / unit_s
    nearest = round(min(max(low, exact), high))  # in this order not-a-number becomes low
    if not abs(exact - nearest) <= SAME * max(abs(nearest), 1):
        raise LimitError(
            device,
            f"set the {what} to {exact:.10g} {unit}",
            f"it takes whole {unit} from {low} to {high}",
            f"The nearest possible value is {nearest} {unit}.",
        )
    return nearest


def within(device: str, what: str, value: int, unit: str, limits: tuple[int, int]) -> int:
    """Return ``value`` if it is an integer within ``limits``, else raise `LimitError`."""
    low, high = limits
    if value != int(value) or not low <= value <= high:
        raise LimitError(
            device,
            f"set the {what} to {value} {unit}".rstrip(),
            f"it takes whole numbers from {low} to {high} {unit}".rstrip(),
            "Choose a value inside these limits.",
        )
    return int(value)


def binning_code(device: str, bin_width_s: float, base_ps: float, steps: int) -> int:
    """Return n for a bin width of ``base_ps * 2**n``, 0 <= n < ``steps``.

    Raises
    ------
    LimitError
        If there is no such n; it lists the nearest two bin widths.
    """
    width_ps = bin_width_s * 1e12
    ideal = min(log2(width_ps / base_ps), steps) if width_ps > 0 else 0.0
    code = min(max(round(ideal), 0), steps - 1)
    if abs(base_ps * 2**code - width_ps) <= SAME * base_ps * 2**code:
        return code
    lower = min(max(floor(ideal), 0), steps - 2)
    raise LimitError(
        device,
        f"set the bin width to {width_ps:.10g} ps",
        f"it makes bins of {base_ps:g} ps times a power of two, up to {base_ps * 2 ** (steps - 1):g} ps",
        f"The nearest are {base_ps * 2**lower:g} ps and {base_ps * 2 ** (lower + 1):g} ps.",
    )


def length_code(bins: int, span_s: float, bin_width_s: float) -> int:
    """Return n of the shortest histogram, 1024 times 2**n, that holds ``bins`` bins and covers ``span_s``.

    A span beyond the longest histogram is not refused: the instrument warns of that itself.
    """
    spanned = min(ceil(span_s / bin_width_s * (1 - SAME)), MAX_HISTOGRAM_BINS)
    needed = max(bins, spanned, SHORTEST_HISTOGRAM_BINS)
    return ceil(log2(needed / SHORTEST_HISTOGRAM_BINS))
