"""The picture of dark counts, ambient light and afterpulses."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.calibrate.afterpulses import USUAL_DECAY_S, Record, expected
from rig.model.calibrations.kinds import DarkRates
from rig.model.quantities import show

_COLOURS = ("#20639b", "#c1440e", "#3a7d44", "#7b4b94", "#8a6d3b")


def dark_figure(rates: Sequence[NDArray[np.float64]], records: Sequence[Record], found: DarkRates) -> Figure:
    """Draw rates part by part, afterpulses after the pulse with what the fit leaves, and against hold-off.

    Parameters
    ----------
    rates
        Counts a second of each part, covered and uncovered.
    records
        At each hold-off.
    found
        The calibration.
    """
    figure = Figure(figsize=(13, 8), dpi=100, facecolor="white", layout="constrained")
    axes = figure.subplot_mosaic(
        [["rates", "decay"], ["outlasting", "residuals"]], width_ratios=(1, 1.5), height_ratios=(1.4, 1)
    )
    percent = (100 * found.afterpulse_probability, 100 * found.afterpulse_probability_error)
    after = f"afterpulses {_with_error(*percent)} %"
    if found.afterpulse_decay_s and found.afterpulse_decay_error_s:
        after += (
            f", decay {_with_error(1e9 * found.afterpulse_decay_s, 1e9 * found.afterpulse_decay_error_s)} ns"
        )
    figure.suptitle(
        f"dark counts {_with_error(found.dark_hz, found.dark_error_hz)} Hz, "
        f"ambient light {_with_error(found.ambient_hz, found.ambient_error_hz)} Hz, {after}"
    )
    _draw_rates(axes["rates"], rates)
    decay_s = found.afterpulse_decay_s or USUAL_DECAY_S
    for record, colour in zip(records, _COLOURS * len(records), strict=False):
        _draw_record(axes["decay"], axes["residuals"], record, found.afterpulse_probability, decay_s, colour)
    quiet = [record.counts[record.quiet].mean() * max(len(record.counts) // 250, 1) for record in records]
    axes["decay"].set(
        yscale="log",
        ylim=(0.5 * min(quiet), 8 * max(quiet)),
        ylabel="counts a bin",
        title="counts after the laser's pulse, with the fit where it is quiet",
    )
    axes["decay"].legend(loc="upper right", fontsize="small")
    axes["residuals"].axhline(0, color="0.5", linewidth=0.8)
    axes["residuals"].set(
        xlim=axes["decay"].get_xlim(),
        xlabel="time after the first light (ns)",
        ylabel="residual (standard errors)",
        title=f"chi2 a bin {found.chi2_per_bin:.2f}",
    )
    _draw_outlasting(axes["outlasting"], found, decay_s)
    return figure


def _draw_rates(axes: Axes, rates: Sequence[NDArray[np.float64]]) -> None:
    for hz, name, colour in zip(rates, ("lens covered", "uncovered, beam blocked"), _COLOURS, strict=False):
        axes.plot(np.arange(1, len(hz) + 1), hz, "o", color=colour, label=name)
        axes.axhline(hz.mean(), color=colour, linewidth=0.8)
    axes.set(yscale="log", xlabel="part of the measurement", ylabel="counts a second")
    axes.legend(loc="center right")


def _draw_record(axes: Axes, below: Axes, record: Record, p: float, decay_s: float, colour: str) -> None:
    """Draw about 250 bins over the period."""
    size = max(len(record.counts) // 250, 1)
    quiet = record.quiet
    first = int(quiet[0] - (np.ceil(record.hold_off_s / record.bin_width_s) + 16))
    counts = _together(np.roll(record.counts, -first), size)
    time_ns = 1e9 * (np.arange(len(counts)) + 0.5) * size * record.bin_width_s
    axes.plot(time_ns, counts, ".", markersize=3, color=colour, alpha=0.6,
              label=f"hold-off {show(record.hold_off_s, 's')}")  # fmt: skip
    due, seen = _together(expected(record, p, decay_s), size), _together(record.counts[quiet], size)
    bins = len(record.counts)
    begin = (quiet[0] - first) % bins
    due_ns = 1e9 * (begin + (np.arange(len(due)) + 0.5) * size) * record.bin_width_s
    axes.plot(due_ns, due, color=colour, linewidth=1.2)
    below.plot(due_ns, (seen - due) / np.sqrt(due), ".", markersize=3, color=colour)


def _draw_outlasting(axes: Axes, found: DarkRates, decay_s: float) -> None:
    hold_ns = 1e9 * np.array(found.hold_off_s)
    axes.errorbar(hold_ns, 100 * np.array(found.after_hold_off), 100 * np.array(found.after_hold_off_error),
                  fmt="o", color=_COLOURS[0], capsize=3, label="measured, one by one")  # fmt: skip
    grid_ns = np.linspace(0, 1.2 * hold_ns.max(), 200)
    due = found.afterpulse_probability * np.exp(-grid_ns * 1e-9 / decay_s)
    axes.plot(grid_ns, 100 * due, color=_COLOURS[1], linewidth=1, label="p exp(-h / tau), all together")
    axes.set(
        xlabel="hold-off h (ns)", ylabel="afterpulses a detection (%)", yscale="log", xlim=(0, grid_ns[-1]),
        title="probability that a carrier outlasts the hold-off",
    )  # fmt: skip
    axes.legend(loc="upper right", fontsize="small")


def _together(values: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    whole = len(values) // size * size
    return values[:whole].reshape(-1, size).sum(axis=1)


def _with_error(value: float, error: float) -> str:
    """Write a value and its error to two digits of the error, e.g. ``10.02 ± 0.22``."""
    digits = max(1 - int(np.floor(np.log10(error))), 0) if error > 0 else 3
    return f"{value:.{digits}f} ± {error:.{digits}f}"
