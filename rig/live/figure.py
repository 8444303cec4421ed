"""How a scan that is under way is drawn: one figure, redrawn in place."""

from collections.abc import Callable
from datetime import datetime

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import AutoLocator
from numpy.typing import NDArray

from recon.accumulate import Picture
from rig.live.state import Seen, Subject
from rig.live.wall import WallMap, squares_in_words
from rig.model.colours import DEPTH_COLOURS, NO_SURFACE
from rig.model.quantities import show, show_duration, show_length
from rig.show.sheet import COLOURS
from rig.show.volume import X_LABEL, depth_range, draw_front, say_across

#: Size of the figure: inches, and pixels an inch.
SIZE_IN, DPI = (12.0, 8.0), 100
COUNT_COLOURS = "cividis"
LINE, EDGE, MUTED = "#20639b", "#b35900", "0.35"
#: Foreground and background of what is said of the laser: by whether it is on, None where that is not known.
LIGHT_COLOURS = {True: ("white", "#b2182b"), False: ("white", "#3a5f3a"), None: ("black", "#ffd500")}
#: A panel's greatest width and height, in inches; its upper edge, and the lower one of the curves.
PANEL_IN, TOP, BOTTOM = (2.76, 2.6), 0.815, 0.135
#: The edges of the gate; they are smeared over the wall by as much as path delays differ.
GATE = ("gate opens", "gate closes")
#: Percentiles of the counts that the colours span: a glint does not make all else dark.
COUNTS_PERCENT = (1.0, 99.0)
#: Behind words in a panel.
NOTE = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 2.0}
#: Warnings that are shown, the newest.
WARNINGS = 2
#: Letters of a line at most.
LETTERS = 150


class LiveFigure:
    """Draws what is known of a scan into a figure.

    Parameters
    ----------
    figure
        An empty one; its size is set.
    subject
        What was known before the first photon.
    """

    def __init__(self, figure: Figure, subject: Subject) -> None:
        self.figure, self._subject = figure, subject
        figure.set_size_inches(*SIZE_IN)
        figure.set_facecolor("white")
        panels = [self._panel(left, subject) for left in (0.06, 0.38, 0.70)]
        (self._counts, counts_bar), (self._front, front_bar), (self._depth, depth_bar) = panels
        below = self._counts.get_position().y0 - 0.15
        self._histogram = figure.add_axes((0.06, BOTTOM, 0.53, below - BOTTOM))
        self._rate = figure.add_axes((0.67, BOTTOM, 0.29, below - BOTTOM))
        self._progress = figure.add_axes((0.06, 0.868, 0.9, 0.012))
        self._count_scale, self._depth_scale = Normalize(0, 1), Normalize(0, 1)
        for bar, scale, colours, label in (
            (counts_bar, self._count_scale, COUNT_COLOURS, "photons"),
            (front_bar, Normalize(0, 1), COLOURS, "amplitude / maximum"),
            (depth_bar, self._depth_scale, DEPTH_COLOURS, "depth z (m)"),
        ):
            figure.colorbar(ScalarMappable(scale, colours), cax=bar, label=label)
        self._wall = _wall_image(self._counts, subject, self._count_scale)
        self._picture: Picture | None = None
        self._no_picture()
        self._write_head()
        (self._bins,) = self._histogram.plot([], [], color=LINE, linewidth=0.8, drawstyle="steps-mid")
        (self._rates,) = self._rate.plot([], [], color=LINE, linewidth=1.2)
        self._draw_frames()

    def _panel(self, left: float, subject: Subject) -> tuple[Axes, Axes]:
        """Add a panel as wide and as high as the wall, and its bar of colours."""
        wide, tall = np.maximum(np.ptp(subject.laser_m, axis=0)[:2], 1e-3)
        width, height = PANEL_IN[0], PANEL_IN[0] * tall / wide
        if height > PANEL_IN[1]:
            width, height = PANEL_IN[1] * wide / tall, PANEL_IN[1]
        width, height = width / SIZE_IN[0], height / SIZE_IN[1]
        panel = self.figure.add_axes((left, TOP - height, width, height))
        return panel, self.figure.add_axes((left + width + 0.008, TOP - height, 0.009, height))

    def _write_head(self) -> None:
        """Write what does not change, and make room for what does."""
        subject, write = self._subject, self.figure.text
        write(0.06, 0.955, subject.name, size=16, weight="bold")
        orders = {"snake": "raster", "list": "a list of spots"}
        facts = [
            subject.rig,
            f"{show(subject.exposure_s, 's')} a position",
            f"{subject.steps:,} positions, {orders.get(subject.order, subject.order)}",
            "continuous" if subject.motion == "continuous" else "",
            f"{subject.channels} channels" if subject.channels > 1 else "",
        ]
        write(0.06, 0.926, "  ·  ".join(fact for fact in facts if fact), size=10, color=MUTED)
        self._when = write(0.96, 0.955, "", size=12, ha="right", color=MUTED)
        self._light = write(0.96, 0.892, "", size=11, weight="bold", ha="right", va="center")
        self._how_far = write(0.06, 0.892, "", size=11, va="center")
        self._warnings = write(0.06, 0.022, "", size=9, va="bottom", color="black", linespacing=1.5)
        self._progress.set(xlim=(0, 1), ylim=(0, 1), xticks=[], yticks=[])
        self._progress.set_facecolor("0.9")
        self._rate.set(xticks=[], yticks=[])
        for side in self._progress.spines.values():
            side.set_visible(False)
        (self._bar_done,) = self._progress.barh([0.5], [0], height=1, color=LINE)

    def _draw_frames(self) -> None:
        """Write titles and labels of the curves, and mark the gate."""
        subject, axes = self._subject, self._histogram
        axes.set(xlabel="time after the pulse on the wall (ns)", ylabel="photons a bin", yscale="log")
        axes.set_title("all positions so far", size=11)
        self._rate.set_title("photons a second of exposure", size=11)
        for name, side, (early_s, late_s) in zip(GATE, ("left", "right"), subject.gate_s, strict=False):
            axes.axvspan(early_s * 1e9, late_s * 1e9, color=EDGE, alpha=0.25, linewidth=0)
            at_ns, space = (early_s + late_s) / 2 * 1e9, "   "
            axes.axvline(at_ns, color=EDGE, linewidth=1, linestyle="--")
            axes.text(at_ns, 0.96, space + name + space, transform=axes.get_xaxis_transform(),
                      color=EDGE, size=9, ha=side, va="top", clip_on=True)  # fmt: skip

    def update(self, seen: Seen) -> None:
        """Draw what is known now."""
        now_s = seen.newest_s if np.isfinite(seen.newest_s) else datetime.now().timestamp()
        self._when.set_text(datetime.fromtimestamp(now_s).strftime("%d %b %Y, %H:%M:%S"))
        self._how_far.set_text(_how_far(seen, self._subject))
        self._bar_done.set_width(0 if self._subject.endless else seen.measured / self._subject.steps)
        self._tell_light(seen)
        self._warnings.set_text("\n".join(_short(one) for one in _warnings(seen)))
        self._draw_counts(seen.photons)
        self._draw_histogram(seen)
        self._draw_rates(seen)
        if seen.picture is not None and seen.picture is not self._picture:
            self._draw_picture(seen.picture, seen.title)

    def _tell_light(self, seen: Seen) -> None:
        if seen.light is None:
            self._light.set_text("")
            return
        time_of_day = seen.light.when[11:19]
        words = {
            True: f"LASER ON since {time_of_day}",
            False: f"laser dark, read back {time_of_day}",
            None: f"LASER NOT CONFIRMED DARK at {time_of_day}: TURN ITS KEY OFF",
        }
        colour, back = LIGHT_COLOURS[seen.light.on]
        self._light.set_text(words[seen.light.on])
        self._light.set_color(colour)
        self._light.set_bbox({"facecolor": back, "edgecolor": "none", "boxstyle": "round,pad=0.4"})

    def _draw_counts(self, photons: NDArray[np.float64]) -> None:
        there = photons[np.isfinite(photons)]
        if len(there):
            low, high = np.percentile(there, COUNTS_PERCENT)
            self._count_scale.vmin, self._count_scale.vmax = low, max(high, low + 1)
        self._wall(photons)

    def _draw_histogram(self, seen: Seen) -> None:
        filled = np.flatnonzero(seen.histogram)
        if not len(filled):
            return
        edges_ns, axes = seen.histogram_edges_s * 1e9, self._histogram
        self._bins.set_data((edges_ns[1:] + edges_ns[:-1]) / 2, seen.histogram)
        margin_ns = 0.02 * (edges_ns[filled[-1] + 1] - edges_ns[filled[0]])
        low, high = edges_ns[filled[0]] - margin_ns, edges_ns[filled[-1] + 1] + margin_ns
        axes.set_xlim(low, high)
        axes.set_ylim(0.7, 10 * seen.histogram.max())  # room for words above the curve
        width_ps = (edges_ns[1] - edges_ns[0]) * 1e3
        axes.set_ylabel(f"photons in {width_ps:.3g} ps")

    def _draw_rates(self, seen: Seen) -> None:
        if not len(seen.moments_s):
            return
        last_s = float(seen.moments_s[-1])
        unit, name = (1, "s") if last_s < 180 else (60, "min") if last_s < 10800 else (3600, "h")
        if not self._rate.get_xlabel():
            self._rate.xaxis.set_major_locator(AutoLocator())
            self._rate.yaxis.set_major_locator(AutoLocator())
        self._rates.set_data(seen.moments_s / unit, seen.photons_per_s / 1e3)
        self._rate.set_xlim(0, max(last_s / unit * 1.02, 1e-3))
        self._rate.set_ylim(0, max(1.15 * float(seen.photons_per_s.max()) / 1e3, 1e-3))
        self._rate.set(xlabel=f"time since the first photons ({name})", ylabel="thousand photons/s")

    def _no_picture(self) -> None:
        for axes, words in ((self._front, "live image"), (self._depth, "depth of the surface")):
            axes.set(xticks=[], yticks=[])
            axes.set_facecolor(NO_SURFACE)
            axes.set_title(words, size=11)
            say_across(axes, "not yet")

    def _draw_picture(self, picture: Picture, title: str) -> None:
        self._picture = picture
        grid, surface = picture.grid, picture.surface
        largest = float(picture.front.max())
        front = picture.front / largest if largest > 0 else picture.front
        found = np.isfinite(surface.depth_m)
        low, high = depth_range(surface.depth_m[found] if found.any() else grid.z_m)
        self._depth_scale.vmin, self._depth_scale.vmax = low, high
        for axes, image, colours, scale in (
            (self._front, front, COLOURS, Normalize(0, 1)),
            (self._depth, surface.depth_m, DEPTH_COLOURS, self._depth_scale),
        ):
            axes.clear()
            axes.set_facecolor(NO_SURFACE)
            draw_front(axes, image, grid.x_m, grid.y_m, colours, scale)
            axes.set_ylabel("")
            axes.set_yticklabels([])
            if surface.empty:
                say_across(axes, "no signal above noise")
        wave = show_length(picture.pulse.wavelength_m)
        self._front.set_title(title, size=11)
        self._front.text(0.02, 0.03, f"wavelength {wave}", transform=self._front.transAxes, color="white")
        self._depth.set_title("depth of the surface (light grey: none)", size=11)


def _wall_image(axes: Axes, subject: Subject, scale: Normalize) -> Callable[[NDArray[np.float64]], None]:
    """Prepare the counts over the wall; return what draws (S,) counts, NaN where nothing was measured."""
    axes.set_facecolor(NO_SURFACE)
    spots_m, wall = subject.laser_m, WallMap.of(subject.laser_m, subject.rounds)
    if not wall.even:
        dots = axes.scatter(spots_m[:, 0], spots_m[:, 1], c=np.full(len(spots_m), np.nan), s=9,
                            cmap=COUNT_COLOURS, norm=scale, plotnonfinite=False)  # fmt: skip
        axes.invert_xaxis()
        axes.set(aspect="equal", xlabel=X_LABEL, ylabel="y (m)")
        draw: Callable[[NDArray[np.float64]], None] = dots.set_array
    else:
        x, y = wall.cells.x, wall.cells.y
        empty = np.full((y.count, x.count), np.nan)
        drawn = draw_front(axes, empty, x.coordinates_m, y.coordinates_m, COUNT_COLOURS, scale)
        note = axes.text(0.02, 0.03, "", transform=axes.transAxes, size=9, bbox=NOTE)

        def draw(photons: NDArray[np.float64]) -> None:
            image, side = wall.image(photons)
            drawn.set_array(image)
            note.set_text(squares_in_words(side))
            note.set_visible(side > 1)

    axes.set_title("photons (light grey: not measured)", size=11)
    return draw


def _how_far(seen: Seen, subject: Subject) -> str:
    """Say how far the scan is, and when it will end."""
    told = [f"{seen.measured:,} of {subject.steps:,} positions ({seen.measured / subject.steps:.0%})"]
    if subject.endless:
        told = [f"{seen.measured:,} positions, {seen.measured // subject.frame_steps:,} frames until stopped"]
    if seen.lost:
        told.append("the scanning program has ended")
    elif seen.ended is not None:
        told.append(f"{seen.ended.outcome.value}: {seen.ended.reason}")
    elif seen.left_s is not None and seen.ends_s is not None:
        ends = datetime.fromtimestamp(seen.ends_s)
        told.append(f"{show_duration(round(seen.left_s))} left, ends about {ends:%H:%M:%S}")
    elif seen.phase:
        told.append(seen.phase)
    if seen.ended is not None or seen.lost:
        told.append(f"{seen.total:,} photons")
    elif len(seen.photons_per_s):
        told.append(f"now {show(float(seen.photons_per_s[-1]), 'photons/s')}")
    elif seen.rates is not None:
        told.append(f"{show(seen.rates.input_hz, 'counts/s')}, sync {show(seen.rates.sync_hz, 'Hz')}")
    return _short("  ·  ".join(told), 110)


def _warnings(seen: Seen) -> list[str]:
    """Return the newest warnings, each with the positions that it concerns."""
    newest = seen.warnings[-WARNINGS:]
    older = len(seen.warnings) - len(newest)
    lines = [
        f"{one.kind.capitalize()}, positions {one.first:,} to {one.last:,}: {one.sentence}" for one in newest
    ]
    if older:
        lines[0] += f" ({older} more in the log)"
    return lines


def _short(line: str, letters: int = LETTERS) -> str:
    line = " ".join(line.split())
    return line if len(line) <= letters else line[: letters - 3] + "..."
