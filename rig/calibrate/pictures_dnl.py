"""The picture of the bins' widths."""

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import norm

from rig.calibrate.dnl import blocks_off
from rig.model.calibrations.kinds import BinWidths


def dnl_figure(found: BinWidths) -> Figure:
    """Draw widths over time, their distribution beside counting noise, and neighbours taken together."""
    counted = np.array([np.nan if width is None else 100 * (width - 1) for width in found.measured])
    known = np.isfinite(counted)
    centres_ns = 1e9 * (found.first_bin_s + (np.arange(len(counted)) + 0.5) * found.bin_width_s)
    noise = 100 * found.noise
    figure = Figure(figsize=(12, 7.5), dpi=100, facecolor="white", layout="constrained")
    axes = figure.subplot_mosaic([["widths", "widths"], ["spread", "together"]])
    figure.suptitle(
        f"bin widths: {found.counts_per_bin:,.0f} counts a bin, non-linearity "
        f"{100 * found.nonlinearity:.3f} % rms "
        f"(at most {100 * found.nonlinearity_at_most:.3f} %), {100 * found.kept:.1f} % of a deviation "
        "believed"
    )

    panel = axes["widths"]
    panel.plot(centres_ns, counted, ".", markersize=2, color="0.6", label="as counted")
    panel.plot(centres_ns[known], 100 * (found.widths[known] - 1), ".", markersize=2, color="#20639b",
               label="believed: shrunk towards 0")  # fmt: skip
    if not known.all():
        start = centres_ns[~known][0]
        panel.axvspan(start, centres_ns[-1], color="0.9", label="not measured: after the sync period")
    panel.set(xlabel="time after the sync pulse (ns)", ylabel="width, deviation from mean (%)")
    panel.legend(loc="upper right", markerscale=4)

    panel = axes["spread"]
    off = counted[known]
    edges = np.linspace(-1, 1, 61) * max(np.abs(off).max(), 3 * noise)
    panel.hist(off, edges, color="0.75", label="as counted")
    believed = norm.pdf(edges, scale=noise) * len(off) * (edges[1] - edges[0])
    panel.plot(edges, believed, color="#c1440e", label=f"counting noise alone, {noise:.3g} %")
    panel.set(xlabel="deviation (%)", ylabel="bins")
    panel.legend(loc="upper right", fontsize="small")

    panel = axes["together"]
    together = blocks_off(off)
    size = len(off) // len(together)
    error = noise / np.sqrt(size)
    middle_ns = centres_ns[known][: len(together) * size].reshape(-1, size).mean(axis=1)
    panel.axhspan(-2 * error, 2 * error, color="#c1440e", alpha=0.15, label="two standard errors of counting")
    panel.plot(middle_ns, together, ".-", linewidth=0.6, color="#20639b")
    panel.set(
        xlabel="time after the sync pulse (ns)",
        ylabel="mean deviation (%)",
        title=f"{size} neighbouring bins together: flat where the light is steady",
    )
    panel.legend(loc="upper right", fontsize="small")
    return figure
