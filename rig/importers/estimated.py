"""What a file lacks, estimated from its data on request, before it is read for good."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from recon.capture import Capture
from recon.errors import ReconError
from recon.estimate import Estimate, bin_width, from_first_bounce, profile, time_origin, wall_size
from rig.errors import UsageError
from rig.importers.content import Content
from rig.importers.options import SPELLING, Given, Options
from rig.importers.places import with_places
from rig.model.quantities import show, show_length

#: What can be estimated, by its name after --estimate.
NAMES = ("time-origin", "bin-width", "wall-size")
#: The option that gives it, and any value to read the file with until it is known.
_TRIAL = {"bin-width": ("bin_width_s", 16e-12), "wall-size": ("wall_size_m", 1.0)}
#: Reads a file with options.
Read = Callable[[Options], Content]


@dataclass(frozen=True)
class Completed:
    """What was found for a file.

    Attributes
    ----------
    given
        What was given, and what was estimated beside it.
    zero_s
        When the pulse is on the wall, in the file's time.
    estimates
        All estimates, in the order in which they were made.
    """

    given: Given
    zero_s: float
    estimates: tuple[Estimate, ...]

    def applied(self, content: Content) -> Content:
        """Return content read with `given`, with its time counted from the pulse on the wall."""
        fade_s = content.fade_from_s
        if self.zero_s and fade_s is not None:
            fade_s = fade_s - self.zero_s if fade_s > self.zero_s else None
        told = tuple(f"{in_words(estimate)}: estimated from {estimate.how}" for estimate in self.estimates)
        return replace(
            content,
            first_bin_s=content.first_bin_s - self.zero_s,
            fade_from_s=fade_s,
            assumed=(*content.assumed, *told),
        )


def in_words(estimate: Estimate) -> str:
    """Return an estimate with its interval, e.g. ``bin width 4.1 ps (3.6 to 4.3 ps)``."""
    name = {"time-origin": "time zero"}.get(estimate.quantity, estimate.quantity.replace("-", " "))
    value, low, high = (
        show_length(number) if estimate.quantity == "wall-size" else show(number, "s")
        for number in (estimate.value, estimate.low, estimate.high)
    )
    return f"{name} {value} ({low} to {high})"


def completed(read: Read, given: Given, wanted: Sequence[str], path: Path) -> Completed:
    """Estimate what is wanted.

    Parameters
    ----------
    read
        Reads the file; it is called more than once.
    given
        What a person said of it.
    wanted
        Names of `NAMES`.
    path
        The file.

    Raises
    ------
    UsageError
        If a name is none, what is wanted is given or in the file, or the data cannot tell.
    """
    _check(wanted, given)
    if not wanted:
        return Completed(given, 0.0, ())
    trial = {**given, **{_TRIAL[name][0]: _TRIAL[name][1] for name in wanted if name in _TRIAL}}
    capture, fade_s = _capture(lambda: _read(read, cast(Given, trial), wanted, path), wanted, path)
    estimates: list[Estimate] = []
    try:
        if "time-origin" in wanted:
            estimates.append(_zero(capture, fade_s, alone=len(wanted) == 1))
            capture = replace(capture, first_bin_s=capture.first_bin_s - estimates[0].value)
        if "bin-width" in wanted:  # its fade is in seconds that are not known yet
            estimates.append(bin_width(capture))
        if "wall-size" in wanted:
            estimates.append(wall_size(capture, fade_s))
    except ReconError as error:
        raise UsageError(f"{path}: {error}") from error
    found = {_TRIAL[e.quantity][0]: e.value for e in estimates if e.quantity in _TRIAL}
    zero_s = sum(e.value for e in estimates if e.quantity == "time-origin")
    return Completed(cast(Given, {**given, **found}), zero_s, tuple(estimates))


def _check(wanted: Sequence[str], given: Given) -> None:
    for name in wanted:
        if name not in NAMES:
            raise UsageError(f"--estimate {name}: only {', '.join(NAMES)} can be estimated")
        option = _TRIAL.get(name, ("",))[0]
        if given.get(option) is not None:
            raise UsageError(f"{SPELLING[option]} is given; leave {name} out of --estimate")
    if {"bin-width", "wall-size"} <= set(wanted):
        raise UsageError(
            "bin width and wall size cannot be estimated together: with all times and the wall twice as "
            "large a scene twice as large gives the same record. Give one, with --bin-width or "
            "--wall-size"
        )
    if {"time-origin", "bin-width"} <= set(wanted):
        raise UsageError(
            "time zero and bin width cannot be estimated together: a later record and a longer record "
            "are equally sharp. Give the bin width with --bin-width"
        )


def _zero(capture: Capture, fade_s: float | None, alone: bool) -> Estimate:
    """Return time zero; beside an unknown wall size from the first bounce alone."""
    if alone:
        return time_origin(capture, fade_s)
    bounce = from_first_bounce(profile(capture))
    if bounce is None:
        raise UsageError(
            "time zero and wall size can be estimated together only where a confocal record holds the first "
            "bounce, and this one does not. Give the wall's size with --wall-size"
        )
    return bounce


def _read(read: Read, trial: Given, wanted: Sequence[str], path: Path) -> Content:
    options = Options(**trial)
    content = read(options)
    for name in wanted:
        if name in _TRIAL and _TRIAL[name][0] in options.not_taken():
            raise UsageError(f"{path} contains its {name.replace('-', ' ')}; leave it out of --estimate")
    return with_places(content, path)


def _capture(again: Callable[[], Content], wanted: Sequence[str], path: Path) -> tuple[Capture, float | None]:
    """Return the file as it is, less the path delays, and when its own light of the wall ends."""
    content = again()
    first_s = np.array([content.first_bin_s])
    if content.delay_s is not None:
        first_s = content.first_bin_s - content.delay_s
    elif content.delays is not None:
        first_s = content.first_bin_s - content.delays.delay_s(content.laser_m, content.detector_m)
    elif "bin-width" in wanted:
        return _as_read(content, again, np.zeros(1)), None
    if "bin-width" in wanted:
        raise UsageError(
            f"{path}: its time includes flights to the wall, which are known in seconds, not in bins, "
            "so the bin width cannot be estimated; give it with --bin-width"
        )
    return _as_read(content, again, first_s), content.fade_from_s


def _as_read(content: Content, again: Callable[[], Content], first_s: NDArray[np.float64]) -> Capture:
    records = _Records(again, (len(content.laser_m), content.bins))
    return Capture(records, content.bin_width_s, first_s, content.laser_m, content.detector_m)


@dataclass(frozen=True)
class _Records:
    """The records of a file, read anew each time; a `recon.capture.Histograms`."""

    again: Callable[[], Content]
    shape: tuple[int, int]

    def blocks(self, bins: slice = slice(None)) -> Iterator[tuple[slice, NDArray[Any]]]:
        """Yield (positions, counts), in order."""
        start = 0
        for block in self.again().blocks:
            yield slice(start, start + len(block)), np.asarray(block)[:, bins]
            start += len(block)
