"""Time zero, bin width and wall size, each from a record that has all else."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from recon.capture import C_M_PER_S, Capture
from recon.estimate.first_bounce import first_bounce_until_s, from_first_bounce
from recon.estimate.focus import Focus, Trial, cannot, sharpest, side_m, wavelength_m
from recon.estimate.record import Profile, profile, thinned
from recon.estimate.value import Estimate, EstimateError

#: Radius of round bodies that must not deceive an estimate [m]: of a head. A ball of radius r is sharpest
#: when it is imaged r farther, as its centre; with one detector spot r / 2 farther, as the mirrored source.
ROUND_M = 0.12
#: The interval of depths, in parts of the depth, beyond which an estimate is none.
WIDEST = 0.5
#: What an estimate from sharpness was read off, in words.
SHARPEST = "the sharpest image"


def time_origin(capture: Capture, fade_from_s: float | None = None) -> Estimate:
    """Estimate when the pulse is on the wall, in the record's own time.

    It is read off the first bounce, where a confocal record holds it. Else the record is moved in time until
    its image is sharpest: time and depth are told apart by how much the arrivals bend over the wall, and by
    nothing else.

    Parameters
    ----------
    capture
        The record, its time axis counted from any moment.
    fade_from_s
        Time before which it holds the wall's own light, on the same axis.

    Raises
    ------
    EstimateError
        If the data cannot tell.
    """
    whole = profile(capture)
    bounce = from_first_bounce(whole)
    if bounce is not None:
        return bounce
    merge = max(1, int(wavelength_m(capture) / (8 * C_M_PER_S * capture.bin_width_s)))
    record, first_s, last_s = _hidden(capture, whole, lambda first_s: merge, fade_from_s)

    def moved(depth_m: float) -> Trial:
        later_s = 2 * depth_m / C_M_PER_S - first_s
        trial = replace(record, first_bin_s=record.first_bin_s + later_s)
        return Trial(trial, (last_s + later_s) * C_M_PER_S / 2)

    found = sharpest(record, moved)
    return _estimate(
        "time-origin", found, lambda depth_m: first_s - 2 * depth_m / C_M_PER_S, _round_m(record)
    )


def bin_width(capture: Capture, fade_from_s: float | None = None) -> Estimate:
    """Estimate the width of a bin; time zero and the wall's size must be right.

    Parameters
    ----------
    capture
        The record with bins of any width; its time axis is taken to widen with them.
    fade_from_s
        Time before which it holds the wall's own light, on that axis.

    Raises
    ------
    EstimateError
        If the data cannot tell.
    """
    found, first_s, round_m = _stretched(capture, fade_from_s)
    width_s = capture.bin_width_s
    return _estimate(
        "bin-width", found, lambda depth_m: width_s * 2 * depth_m / (C_M_PER_S * first_s), round_m
    )


def wall_size(capture: Capture, fade_from_s: float | None = None) -> Estimate:
    """Estimate the longer side of the scanned wall; times must be right.

    Parameters
    ----------
    capture
        The record with a wall of the right shape and any size. A wall k times larger and times k times longer
        give the same record, so that it is the same question as that for the bin width.
    fade_from_s
        Time before which it holds the wall's own light.

    Raises
    ------
    EstimateError
        If the data cannot tell.
    """
    found, first_s, _ = _stretched(capture, fade_from_s)
    side = side_m(capture)

    def size_m(depth_m: float) -> float:
        return side * C_M_PER_S * first_s / (2 * depth_m)

    # the body's size is in metres: on the wall as given it is smaller by what the wall is to be larger
    round_m = _round_m(capture) / 2 * side / size_m(found.depth_m)
    return _estimate("wall-size", found, size_m, round_m)


def _stretched(capture: Capture, fade_from_s: float | None) -> tuple[Focus, float, float]:
    """Return where the record with stretched times is sharpest, its first light, and the allowance."""
    whole = profile(capture)
    until_s = first_bounce_until_s(whole)
    if until_s is not None:
        fade_from_s = max(until_s, -np.inf if fade_from_s is None else fade_from_s)
    first_bins = side_m(capture) / wavelength_m(capture) * 12

    def merge(first_s: float) -> int:
        return max(1, int(first_s / capture.bin_width_s / first_bins))

    record, first_s, last_s = _hidden(capture, whole, merge, fade_from_s)
    if first_s <= 0:
        raise cannot("hidden light arrives before time zero")

    def moved(depth_m: float) -> Trial:
        times = 2 * depth_m / (C_M_PER_S * first_s)
        trial = replace(
            record, bin_width_s=record.bin_width_s * times, first_bin_s=record.first_bin_s * times
        )
        return Trial(trial, depth_m * last_s / first_s)

    return sharpest(record, moved), first_s, _round_m(record) / 2


def _hidden(
    capture: Capture, whole: Profile, merge: Callable[[float], int], fade_from_s: float | None
) -> tuple[Capture, float, float]:
    """Return the record thinned, and when its hidden light begins and ends."""
    if len(capture.detector_m) > 1 and not capture.confocal:
        raise EstimateError(
            "estimate",
            "a value from pairs of laser and detector spots",
            "only records with one detector spot, and confocal ones, are tried",
            "Give the value.",
        )
    first_s, _ = whole.hidden_s(fade_from_s)
    record = thinned(capture, merge(first_s), fade_from_s)
    first_s, last_s = profile(record).hidden_s()
    return record, first_s, last_s


def _round_m(capture: Capture) -> float:
    return ROUND_M if capture.confocal else ROUND_M / 2


def _estimate(quantity: str, found: Focus, value_of: Callable[[float], float], round_m: float) -> Estimate:
    """Turn depths into the quantity asked for.

    Raises
    ------
    EstimateError
        If the interval is so wide that it says nothing.
    """
    nearest_m = min(found.nearest_m, found.depth_m - round_m)
    if found.farthest_m - nearest_m > WIDEST * found.depth_m or nearest_m <= 0:
        raise cannot(
            f"with the first hidden light anywhere from {max(0.0, nearest_m):.2g} m to "
            f"{found.farthest_m:.2g} m it is about as sharp"
        )
    low, high = sorted((value_of(nearest_m), value_of(found.farthest_m)))
    return Estimate(quantity, value_of(found.depth_m), low, high, SHARPEST)
