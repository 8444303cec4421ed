"""Pictures of a scan's raw data, as in Figures M.3 and M.7 of Liu et al. (2019)."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from recon.capture import Capture
from rig.model.colours import LIGHT_COLOURS
from rig.model.quantities import show, show_length
from rig.show.statistics import Streak, Tally, first_bins, histograms_of, streak, tally
from rig.show.volume import WIDTH_PX

_DPI = 100
_LINE = "#20639b"
#: Part of the photons of the histograms shown that may come after the end of their axis: dark counts come
#: until the gate closes, and would press all else together.
_UNSEEN = 0.005


@dataclass(frozen=True)
class RawView:
    """What is drawn of one scan.

    Attributes
    ----------
    name
        What it is called in the picture.
    tally
        Totals of each position.
    times_s, histograms
        For the positions with most photons, with the median, and with the largest bin: the centres of the
        bins counted [s], and their counts.
    laser_m
        (3, 3) where these positions are.
    """

    name: str
    tally: Tally
    times_s: list[NDArray[np.float64]]
    histograms: list[NDArray]
    laser_m: NDArray[np.float64]


def raw_view(name: str, capture: Capture) -> RawView:
    """Read what is drawn of a scan."""
    counted = tally(capture)
    chosen = [counted.most, counted.median, counted.peak]
    first = np.broadcast_to(first_bins(capture, counted.statistics.from_s), capture.positions)
    origin_s = np.broadcast_to(capture.first_bin_s, capture.positions)
    times_s, histograms = [], []
    for position, counts in zip(chosen, histograms_of(capture, chosen), strict=True):
        bins = np.arange(first[position], capture.bins)
        times_s.append(origin_s[position] + (bins + 0.5) * capture.bin_width_s)
        histograms.append(counts[bins])
    return RawView(name, counted, times_s, histograms, capture.laser_m[chosen])


def scan_figure(name: str, capture: Capture) -> Figure:
    """Draw one scan: all counts as an image, and three positions (Fig. M.3).

    Parameters
    ----------
    name
        Title.
    capture
        The scan, in rectified time.
    """
    view, image = raw_view(name, capture), streak(capture)
    figure = Figure(figsize=(WIDTH_PX / _DPI, 9.5), dpi=_DPI, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 2)
    _draw_streak(figure, axes[0, 0], image)
    _draw_positions(view, [axes[0, 1], axes[1, 0], axes[1, 1]])
    figure.suptitle(f"{name}\n{_facts(view.tally)}", fontsize=13)
    return figure


def comparison_figure(views: list[RawView]) -> Figure:
    """Draw three positions of each of several scans, one row a scan (Fig. M.7)."""
    size = (WIDTH_PX / _DPI, 0.4 + 3.3 * len(views))
    figure = Figure(figsize=size, dpi=_DPI, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    parts = figure.subfigures(len(views), 1, squeeze=False)
    for part, view in zip(parts[:, 0], views, strict=True):
        _draw_positions(view, list(part.subplots(1, 3)))
        part.suptitle(f"{view.name}: {_facts(view.tally)}", fontsize=12)
    return figure


def _facts(counted: Tally) -> str:
    found = counted.statistics
    return (
        f"{found.positions:,} positions, {found.photons:,.0f} photons after {show(found.from_s, 's')}, "
        f"{found.per_bin:.2g} a bin, at most {found.largest:,.0f}"
    )


def _draw_streak(figure: Figure, axes: Axes, image: Streak) -> None:
    with np.errstate(invalid="ignore"):
        shown = np.ma.masked_where(~(image.counts > 0), image.counts)
    axes.set_facecolor("white")
    drawn = axes.imshow(
        shown,
        aspect="auto",
        extent=(image.time_s[0] * 1e9, image.time_s[-1] * 1e9, image.positions, 0),
        cmap=LIGHT_COLOURS,
        norm=LogNorm(*_count_range(shown)),
        interpolation="nearest",
    )
    bar = figure.colorbar(drawn, ax=axes, label="counts a bin, mean of a block of bins (blank: none)")
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda count, _: f"{count:,g}"))
    filled = np.flatnonzero(np.nansum(image.counts, axis=0))  # after the gate closes there is nothing to see
    last = min(filled[-1] + 2, len(image.time_s) - 1) if len(filled) else -1
    axes.set(
        title="all counts",
        xlabel="time after the pulse on the wall (ns)",
        ylabel="position, line by line",
        xlim=(image.time_s[0] * 1e9, image.time_s[last] * 1e9),
    )


def _count_range(counts: "np.ma.MaskedArray") -> tuple[float, float]:
    """Return the range of the colours of counts, two decades at least."""
    most = float(counts.max()) if counts.count() else 1.0
    return min(float(counts.min()) if counts.count() else 1.0, most / 100), most


def _draw_positions(view: RawView, panels: list[Axes]) -> None:
    titles = ("most photons", "median of photons", "largest bin")
    for i, (axes, title) in enumerate(zip(panels, titles, strict=True)):
        x_m, y_m, _ = view.laser_m[i]
        axes.plot(view.times_s[i] * 1e9, view.histograms[i], color=_LINE, linewidth=0.6)
        axes.set(
            title=f"{title}: laser at ({show_length(x_m)}, {show_length(y_m)})",
            xlabel="time after the pulse on the wall (ns)",
            ylabel="counts a bin",
            xlim=(view.times_s[i][0] * 1e9, _until_s(view) * 1e9),
        )
        axes.set_ylim(bottom=0)
        axes.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 5, 10]))


def _until_s(view: RawView) -> float:
    """Return where the axes of the histograms end: after all but `_UNSEEN` of the photons of each."""
    last_s = [
        times_s[np.searchsorted(np.cumsum(counts), (1 - _UNSEEN) * counts.sum())]
        for times_s, counts in zip(view.times_s, view.histograms, strict=True)
        if counts.any()
    ]
    return float(max(last_s, default=view.times_s[0][-1])) + 0.5e-9
