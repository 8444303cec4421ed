"""Pictures of what calibrations of time measured, fitted and left over."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from rig.calibrate import peaks
from rig.calibrate.first_bounce import FirstBounces
from rig.model.calibrations.kinds import Response, TimeZero
from rig.model.quantities import show

_LINE, _DOTS, _GREY = "#20639b", "#c8553d", "0.6"


def time_zero_figure(bounces: Sequence[FirstBounces], found: TimeZero) -> Figure:
    """Draw one first bounce with its fit, residuals over the wall, and residuals one after the other."""
    figure = Figure(figsize=(13, 4), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(1, 1.2, 1.2))
    first = bounces[0]
    brightest = int(first.counts.argmax())
    time_ns = first.time_s[brightest] * 1e9
    left.semilogy(time_ns, first.rate[brightest], ".", color=_GREY, markersize=4, label="counts")
    left.semilogy(time_ns, first.model[brightest], color=_LINE, linewidth=1.4, label="fit")
    left.axvline(first.arrival_s[brightest] * 1e9, color=_DOTS, linewidth=1, label="arrival")
    left.set(title="a first bounce", xlabel="time after sync (ns)", ylabel="counts a bin", ylim=(0.5, None))
    left.legend(frameon=False)
    spots_m = np.array(found.spots_m)
    each_ps = np.split(
        1e12 * np.array(found.residuals_s), np.cumsum([len(one.index) for one in bounces])[:-1]
    )
    largest = float(np.abs(np.concatenate(each_ps)).max())
    drawn = middle.scatter(
        *spots_m[: len(each_ps[0])].T,
        c=each_ps[0],
        cmap="RdBu_r",
        vmin=-largest,
        vmax=largest,
        s=70,
        marker="s",
    )
    figure.colorbar(drawn, ax=middle, label="measured less fitted (ps)")
    middle.set(title="over the wall", xlabel="x (m), as seen from the wall", ylabel="y (m)", aspect="equal")
    middle.invert_xaxis()
    start = 0
    for number, (one, left_ps) in enumerate(zip(bounces, each_ps, strict=True), 1):
        at, error_ps = start + one.index, 1e12 * one.error_s
        right.errorbar(at, left_ps, error_ps, fmt=".", markersize=4, linewidth=0.7, label=f"visit {number}")
        start = int(at.max()) + 1
    right.axhline(0, color="0.3", linewidth=0.8)
    right.set(title="one after the other", xlabel="position", ylabel="measured less fitted (ps)")
    right.margins(y=0.2)
    right.legend(frameon=False, ncols=len(bounces), loc="upper right")
    figure.suptitle(
        f"time zero: delay {show(found.electronics_delay_s, 's', 6)}, rectified time known to "
        f"{show(found.rectified_error_s, 's', 2)} (worst {show(found.rectified_error_worst_s, 's', 2)}), "
        f"residuals {show(found.residual_s or 0.0, 's', 2)}, chi² {found.chi2:.2f}"
    )
    return figure


def response_figure(found: Response) -> Figure:
    """Draw the response with its fit on a logarithmic scale, and what the fit leaves."""
    shape = peaks.Shape(found.core_fwhm_s / 2.3548200450309493, found.tail_s, found.tail_fraction)
    time_s, response = np.array(found.time_s), np.array(found.response)
    fine_s = np.linspace(time_s[0], time_s[-1], 1500)
    top_s = found.tail_s * found.tail_fraction - found.centroid_s
    figure = Figure(figsize=(9, 6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    above.semilogy(time_s * 1e12, response * 1e-12, ".", color=_DOTS, markersize=4, label="measured")
    curve = shape.density(fine_s + top_s) * 1e-12
    above.semilogy(fine_s * 1e12, curve, color=_LINE, linewidth=1.2, label="core and tail")
    half = curve.max() / 2
    inside = fine_s[curve >= half] * 1e12
    above.plot([inside[0], inside[-1]], [half, half], color="0.2", linewidth=1)
    above.annotate(
        f"{show(found.fwhm_s, 's', 4)} ± {show(found.fwhm_error_s, 's', 1)}",
        (inside[-1], half),
        xytext=(8, -3),
        textcoords="offset points",
    )
    above.set(
        title=f"response: {found.counts:,} counts, tail of {show(found.tail_s, 's', 3)} in "
        f"{100 * found.tail_fraction:.1f} %",
        ylabel="density (1/ps)",
        ylim=(curve.max() * 1e-5, curve.max() * 2),
    )
    above.legend(frameon=False)
    below.plot(time_s * 1e12, (response - shape.density(time_s + top_s)) * 1e-12 / curve.max() * 100, ".",
               color=_DOTS, markersize=3)  # fmt: skip
    below.axhline(0, color="0.3", linewidth=0.8)
    below.set(xlabel="time after the peak (ps)", ylabel="left over\n(% of the peak)")
    return figure
