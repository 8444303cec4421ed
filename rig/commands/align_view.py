"""What is seen while optics are aligned: a large number, and what it is worth."""

import time

import numpy as np
from numpy.typing import NDArray
from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from rig.acquire.events import Event, LightChanged, Noticed, Phase, PhaseChanged, Ready, StepDone
from rig.commands import console
from rig.model.plan import Point
from rig.model.quantities import show, show_length
from rig.model.state import RigState
from rig.show.levels import PILE_UP, Histogram, Levels

#: A terminal is redrawn so often; elsewhere a line is printed so often.
DRAWN_EVERY_S = 0.2
LINE_EVERY_S = 1.0
#: Columns of the histogram and of the bar.
COLUMNS, BAR = 70, 50
_BLOCKS = " ▁▂▃▄▅▆▇█"
_TRENDS = {1: "rising", 0: "steady", -1: "falling"}
_ARROWS = {1: ("▲", "bold green"), 0: ("■", "dim"), -1: ("▼", "bold yellow")}
#: The rows of each figure, three points wide; drawn twice as wide.
_FIGURES = {
    "0": ("███", "█ █", "█ █", "█ █", "███"),
    "1": (" █ ", "██ ", " █ ", " █ ", "███"),
    "2": ("███", "  █", "███", "█  ", "███"),
    "3": ("███", "  █", " ██", "  █", "███"),
    "4": ("█ █", "█ █", "███", "  █", "  █"),
    "5": ("███", "█  ", "███", "  █", "███"),
    "6": ("███", "█  ", "███", "█ █", "███"),
    "7": ("███", "  █", "  █", "  █", "  █"),
    "8": ("███", "█ █", "███", "█ █", "███"),
    "9": ("███", "█ █", "███", "  █", "███"),
    ".": (" ", " ", " ", " ", "█"),
    " ": ("   ", "   ", "   ", "   ", "   "),
}


class AlignmentView:
    """A consumer of scan events that shows the levels: redrawn on a terminal, elsewhere a line each second.

    Parameters
    ----------
    levels
        What is shown; it gets each event first.
    state
        The rig.
    of_a_lap
        Spots of a lap.
    """

    def __init__(self, levels: Levels, state: RigState, of_a_lap: int) -> None:
        self._levels = levels
        self._hold_off_s = state.config.detector.hold_off_s
        self._response_s = state.response_s
        self._of_a_lap = of_a_lap
        self._light = ""
        self._warned: set[str] = set()
        self._drawn_s = 0.0
        self._live = Live(console=console.err, auto_refresh=False, transient=True)
        self.light: LightChanged | None = None

    def __call__(self, event: Event) -> None:
        """Show what happened."""
        match event:
            case LightChanged():
                self.light = event
                self._light = f"{console.tell_light(event)} since {event.when[11:19]}"
            case Ready(warnings=warnings):
                self._warn(warnings)
            case Noticed(sentence=sentence, kind="bias"):
                console.say(sentence)
            case Noticed(sentence=sentence):
                self._warn((sentence,))
            case StepDone(step=step, exposure=exposure):
                self._warn(exposure.warnings)
                self._show(step.spot_m)
            case PhaseChanged(phase=Phase.EXPOSING):
                console.say("Press Ctrl-C to end: the laser is switched off first. Nothing is recorded.")
                if console.err.is_terminal:
                    console.draw(self._live)
            case PhaseChanged(phase=Phase.CLOSING):
                console.wipe(self._live)

    def _warn(self, sentences: tuple[str, ...]) -> None:
        """Warn of what was not warned of before: an exposure says the same as the one before it."""
        for sentence in sentences:
            if sentence not in self._warned:
                self._warned.add(sentence)
                console.warn(sentence)

    def _show(self, spot_m: Point) -> None:
        terminal, now_s = console.err.is_terminal, time.monotonic()
        if now_s - self._drawn_s < (DRAWN_EVERY_S if terminal else LINE_EVERY_S):
            return
        self._drawn_s = now_s
        if terminal:
            self._live.update(self._page(spot_m), refresh=True)
        else:
            console.say(self._line())

    def _line(self) -> str:
        """Return what matters in a line."""
        levels = self._levels
        told = [
            f"{show(levels.now_hz, 'counts/s'):>14}",
            f"{100 * levels.of_best:3.0f} % of the best",
            f"{_TRENDS[levels.trend]:7}",
            f"{100 * levels.of_pulses:.2g} % of {show(levels.sync_hz, 'Hz')}",
            f"peak: {peak_in_words(levels, self._response_s)}",
        ]
        if levels.of_pulses > PILE_UP:
            told.append("PILE-UP")
        return "  ".join(told)

    def _page(self, spot_m: Point) -> Group:
        levels = self._levels
        head = Text.from_markup(f"{self._light}  ").append(
            f"mirror at {spot_in_words(spot_m)}"
            + (f", one of {self._of_a_lap} spots of a circle" if self._of_a_lap > 1 else "")
        )
        return Group(head, Text(), *self._large(), Text(), self._facts(), Text(), *self._pictures(levels))

    def _large(self) -> list[Text]:
        """Return the rate in large figures with where it goes, and a bar of it against the best."""
        levels = self._levels
        figures, unit = steady(levels.now_hz, levels.best_hz)
        arrow, style = _ARROWS[levels.trend]
        rows = [Text("  " + "  ".join(_wide(_FIGURES[one][row]) for one in figures)) for row in range(5)]
        rows[2].append(f"   {arrow} {_TRENDS[levels.trend]}", style)
        rows[4].append(f"   {unit}")
        full = round(BAR * min(levels.of_best, 1.0))
        bar = Text("  ").append("█" * full, "green").append("░" * (BAR - full), "dim")
        bar.append(f" {100 * levels.of_best:.0f} % of the best, {show(levels.best_hz, 'counts/s')}")
        return [*rows, Text(), bar]

    def _facts(self) -> Table:
        """Return the other numbers; always as many lines, so that nothing jumps."""
        levels = self._levels
        name, strongest_hz = levels.strongest
        table = Table.grid(padding=(0, 2))
        table.add_column(style="dim")
        table.add_column()
        percent = f"{100 * levels.of_pulses:.2g} % of {show(levels.sync_hz, 'Hz')} sync pulses"
        warned = Text(f"{percent}: PILE-UP, early photons hide late ones: reduce the light", "bold red")
        table.add_row("pulses with a photon", warned if levels.of_pulses > PILE_UP else Text(percent))
        off = f"{100 * strongest_hz * self._hold_off_s:.2g} % of the time"
        table.add_row("held off", f"{off}, {show(self._hold_off_s, 's')} after each photon")
        if len(levels.names) > 1:
            table.add_row("strongest channel", Text(f"{name}, {show(strongest_hz, 'counts/s')}"))
        table.add_row("mean", show(levels.mean_hz, "counts/s"))
        table.add_row("without light", dark_in_words(levels.dark_hz))
        background = levels.background_hz
        table.add_row(
            "background", "" if background is None else f"{show(background, 'counts/s')} in the gate"
        )
        table.add_row("peak", peak_in_words(levels, self._response_s))
        return table

    def _pictures(self, levels: Levels) -> list[Text]:
        """Return the histogram over its gate, and the rate of the last minute."""
        found = levels.histogram
        minute = sparkline(np.array(levels.minute_hz), best=levels.best_hz)
        history = Text("  last minute  ", "dim").append(minute, "default")
        if found is None:
            return [Text(), Text(), Text(), history]
        ends = f"{show(found.first_bin_s, 's')}", f"{show(found.ends_s, 's')}"
        return [
            Text("  ").append(sparkline(found.columns(COLUMNS))),
            Text("  ").append(gate_line(found, levels.gate_s), "dim"),
            Text(f"  {ends[0]}{ends[1]:>{COLUMNS - len(ends[0])}}", "dim"),
            history,
        ]


def steady(rate_hz: float, best_hz: float) -> tuple[str, str]:
    """Return a rate as figures of the same number and places as long as the best is of the same size."""
    size, prefix = next(((s, p) for s, p in ((1e6, "M"), (1e3, "k")) if best_hz >= s), (1.0, ""))
    places = 0 if best_hz >= 100 * size else 1 if best_hz >= 10 * size else 2
    return f"{rate_hz / size:{4 if places else 3}.{places}f}", f"{prefix}counts/s"


def sparkline(values: NDArray[np.float64], best: float | None = None) -> str:
    """Return values as bars of one line, from zero to the greatest or the best; what is not zero is seen."""
    top = max(values.max(initial=0.0), best or 0.0)
    if not top > 0:
        return _BLOCKS[0] * len(values)
    heights = np.where(values > 0, np.clip(np.rint(values / top * 8), 1, 8), 0).astype(int)
    return "".join(_BLOCKS[height] for height in heights)


def gate_line(histogram: Histogram, gate_s: tuple[float, float]) -> str:
    """Return marks under a histogram where its gate opens and closes."""
    length_s = histogram.ends_s - histogram.first_bin_s
    opens, closes = (
        int(np.clip((at_s - histogram.first_bin_s) / length_s * COLUMNS, 0, COLUMNS - 1)) for at_s in gate_s
    )
    inside = " gate ".center(max(closes - opens - 1, 0), "─")[: max(closes - opens - 1, 0)]
    return f"{' ' * opens}[{inside}]"


def spot_in_words(spot_m: Point) -> str:
    """Return where a spot is on the wall."""
    return f"x = {show_length(spot_m[0])}, y = {show_length(spot_m[1])}"


def dark_in_words(dark_hz: float | None) -> str:
    """Return what was counted before there was light."""
    return (
        "not known: the gate opens with the laser's pulses" if dark_hz is None else show(dark_hz, "counts/s")
    )


def peak_in_words(levels: Levels, response_s: float) -> str:
    """Return when the highest peak comes, and how wide it is."""
    found = levels.histogram.peak(response_s) if levels.histogram else None
    if found is None:
        return "none"
    width = "" if np.isnan(found.width_s) else f", {show(found.width_s, 's')} wide"
    return f"{show(found.time_s, 's', 4)} after the sync pulse{width}"


def _wide(row: str) -> str:
    return "".join(2 * point for point in row)
