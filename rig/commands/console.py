"""What a person sees: messages and progress on stderr, results on stdout."""

import json
import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Self

from rich.cells import cell_len
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from rig.acquire.events import Ended, Event, Grown, LightChanged, Noticed, PhaseChanged, Ready, StepDone
from rig.commands.voice import voice
from rig.errors import printable
from rig.model.quantities import show, show_duration

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.console import RenderableType
    from rich.live import Live

    from rig.files.scan import ScanFile
    from rig.model.devices import Exposure
    from rig.model.plan import Step
    from rig.setup.doctor import Finding


#: Positions whose time says how long the others will take; the first has what happens once in it.
_ENOUGH = 5
#: Columns of what is no terminal: a command or a checksum in it stays in one line.
_WIDEST = 10_000
#: Everything but results.
err = Console(stderr=True, highlight=False, soft_wrap=True)


def say(message: str) -> None:
    """Say something that is not a result."""
    voice.note("say", message)
    if not voice.quiet:
        _print(message)


def announce(message: str) -> None:
    """Say what a person needs who asked for quiet, too: what concerns the light, or answers a question."""
    voice.note("say", message)
    _print(message)


def detail(message: str) -> None:
    """Say what is done, and when: only with ``--verbose``, and in the log."""
    voice.note("detail", message)
    if voice.verbose:
        err.print(Text(f"{voice.elapsed_s:8.3f} s ", "dim"), _plain(message))


def _print(message: str) -> None:
    if voice.verbose:
        err.print(Text(f"{voice.elapsed_s:8.3f} s ", "dim"), _plain(message))
    else:
        err.print(_plain(message))


def warn(message: str) -> None:
    """Warn the person."""
    voice.note("warning", message)
    if not voice.quiet:
        err.print(Text("warning:", "yellow"), _plain(message))


def shout(message: str) -> None:
    """Say what must not be missed."""
    voice.note("shout", message)
    err.print(Text(f" {printable(message).upper()} ", "bold white on red"))


def _shows_bars() -> bool:
    """Return whether bars are drawn: on a terminal, for one who did not ask for quiet."""
    return err.is_terminal and not voice.quiet


def _bar_width() -> int:
    """Return how wide a bar may be, so that what stands beside it fits the line: a wrapped one would stay."""
    return max(6, min(30, err.width - 74))


#: What is drawn and redrawn now, below the messages.
_drawn: "list[Progress | Live]" = []


def draw(what: "Progress | Live") -> None:
    """Begin to draw something that is redrawn; it leaves the terminal while a person is asked something."""
    what.start()
    if what not in _drawn:
        _drawn.append(what)


def wipe(what: "Progress | Live") -> None:
    """Draw it no more."""
    what.stop()
    if what in _drawn:
        _drawn.remove(what)


@contextmanager
def aside() -> "Iterator[None]":
    """Take away what is drawn while a person is asked something."""
    drawn = list(_drawn)
    for one in drawn:
        one.stop()
    try:
        yield
    finally:
        for one in drawn:
            one.start()


def _plain(text: str) -> Text:
    """Return text as it is: no markup in it, and no control characters."""
    return Text(printable(text))


def warn_of(scan: "ScanFile") -> None:
    """Warn of a scan file that is not, or no longer, as its program left it."""
    for sentence in scan.doubts:
        warn(sentence)


def _results(*parts: "RenderableType", width: int | None = None) -> None:
    """Print on stdout, no line with spaces at its end; a file or a pipe gets each row as one whole line.

    On a terminal that is too narrow, cells are folded; nothing is cut short anywhere.
    """
    console = Console(highlight=False)
    if width or not console.is_terminal:
        console = Console(highlight=False, width=width or _WIDEST)
    for part in parts:
        for segments in console.render_lines(part, pad=False):
            line = Text.assemble(*((one.text, one.style or "") for one in segments))
            line.rstrip()
            console.print(line, soft_wrap=True)


def print_facts(title: str, facts: dict[str, str]) -> None:
    """Print names and values as two aligned columns on stdout."""
    voice.note("result", "\n".join([title, *(f"{name}: {value}" for name, value in facts.items())]))
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in facts.items():
        table.add_row(_plain(name), _plain(value))
    _results(Text(printable(title), "bold", overflow="fold"), table)


def print_table(
    header: "Sequence[str]", rows: "Sequence[Sequence[str]]", words: "Sequence[str]" = ()
) -> None:
    """Print rows of text under a header on stdout; columns hold numbers, but for the first and ``words``."""
    rows = [[printable(cell) for cell in row] for row in rows]
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for number, name in enumerate(header):
        table.add_column(name, justify="right" if number and name not in words else "left", no_wrap=True)
    for row in rows:
        table.add_row(*map(Text, row))
    # never cuts a number short, whatever the terminal
    _results(table, width=sum(max(map(cell_len, column)) + 2 for column in zip(header, *rows, strict=True)))


def print_findings(headline: str, findings: "Sequence[Finding]") -> None:
    """Print the results of checks on stdout, each with what to do about it."""
    colours = {"ok": "green", "warning": "yellow", "missing": "red", "optional": "dim"}
    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    table.add_column(overflow="fold", ratio=1)
    for finding in findings:
        verdict = f"[{colours[finding.verdict]}]{finding.verdict}[/]"
        found = _plain(finding.found)
        if finding.remedy:
            found.append("\n").append(printable(finding.remedy), "dim")
        table.add_row(verdict, _plain(finding.what), found)
    _results(Text(printable(headline), "bold", overflow="fold"), table)


def print_json(document: dict[str, Any]) -> None:
    """Print one JSON document on stdout; a failure after it prints none."""
    voice.documented = True
    json.dump({"schema_version": 1, **document}, sys.stdout, indent=2, default=str)
    print()


class ScanProgress:
    """A consumer of scan events that shows phase, positions, photons a second and time left.

    On a terminal one line is redrawn, at most four times a second; elsewhere each tenth prints a line.

    Parameters
    ----------
    positions
        Number of positions in the plan.

    Attributes
    ----------
    began
        Whether anything happened: a scan file was there then.
    """

    def __init__(self, positions: int) -> None:
        self._positions = positions
        self._photons = 0
        self._live_time_s = 0.0
        self._measured = 0
        self.began = False
        self._since_s = time.monotonic()
        self._drawn_s = 0.0
        self._tenth = 0
        self._phase = ""
        self._light = ""
        self._bar = Progress(
            SpinnerColumn(),
            TextColumn("{task.fields[light]}"),
            TextColumn("{task.fields[phase]:>14}"),
            BarColumn(bar_width=_bar_width()),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"),
            TextColumn("{task.fields[left]}"),
            console=err,
            transient=True,
            auto_refresh=False,
            disable=not _shows_bars(),
        )
        self._task = self._bar.add_task("", total=positions, light="", phase="", rate="", left="")

    def __call__(self, event: Event) -> None:
        """Show what happened."""
        self.began = True
        match event:
            case PhaseChanged(phase=phase):
                self._show_phase(phase.value)
            case Ready(rates=rates, warnings=warnings):
                say(f"sync {show(rates.sync_hz, 'Hz')}, {show(rates.input_hz, 'counts/s')}")
                for sentence in warnings:
                    warn(sentence)
            case LightChanged():
                self._light = tell_light(event)
            case Noticed(sentence=sentence, first=first, last=last, kind="warning"):
                warn(f"{sentence} (positions {first} to {last})")
            case Noticed(sentence=sentence, kind="bias" | "loading"):
                say(sentence)
            case StepDone(step=step, exposure=exposure):
                self._count(step, exposure)
            case Grown(plan=plan):
                self._positions = len(plan)
                self._bar.update(self._task, total=self._positions)
            case Ended():
                wipe(self._bar)

    def _show_phase(self, phase: str) -> None:
        self._phase = phase
        if _shows_bars():
            detail(phase)
            draw(self._bar)
            self._draw(0 if phase == "aiming" else None)
        else:
            say(phase)
        self._since_s = time.monotonic()

    def _count(self, step: "Step", exposure: "Exposure") -> None:
        if not self._measured:  # of a scan that is resumed: what is there already is no progress of now
            self._tenth = step.index * 10 // self._positions
        self._measured += 1
        self._photons += exposure.photons
        self._live_time_s += exposure.live_time_s
        self._advance(step.index + 1)

    def _advance(self, done: int) -> None:
        now_s = time.monotonic()
        if _shows_bars():
            if now_s - self._drawn_s > 0.25:
                self._drawn_s = now_s
                self._draw(done)
        elif done * 10 // self._positions > self._tenth:
            self._tenth = done * 10 // self._positions
            percent = f"{done * 100 // self._positions:3d} %"
            parts = [percent, f"{done}/{self._positions}", self._rate(), self._left(done)]
            say("  ".join(filter(None, parts)))

    def _draw(self, done: int | None) -> None:
        left = self._left(done) if done else ""
        self._bar.update(
            self._task, completed=done, light=self._light, phase=self._phase, rate=self._rate(), left=left
        )
        self._bar.refresh()

    def _rate(self) -> str:
        return show(self._photons / self._live_time_s, "photons/s") if self._live_time_s else ""

    def _left(self, done: int) -> str:
        if self._measured < _ENOUGH:
            return ""
        each_s = (time.monotonic() - self._since_s) / self._measured
        return f"~{show_duration(round(each_s * (self._positions - done)))} left"


def tell_light(event: LightChanged) -> str:
    """Tell what is known of the light, and return it in short."""
    time_of_day = event.when[11:19]
    voice.note("light", event.words)
    if event.on is None:
        err.print(
            f"[bold white on red] {time_of_day} THE LASER CANNOT BE CONFIRMED DARK: "
            "TURN ITS KEY OFF BY HAND, NOW [/]"
        )
        return "[bold red]LASER ?[/]"
    if event.on:
        err.print(f"[bold red]LASER ON[/] since {time_of_day}")
        return "[bold red]LASER ON[/]"
    err.print(f"laser dark, {event.how.removesuffix(' twice')} {time_of_day}")
    return "dark"


class Counting:
    """A consumer of the events of several scans that shows how many positions they measured, on a terminal.

    Parameters
    ----------
    what
        What is measured.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self._positions = 0
        self._status = err.status(_plain(what))

    def __enter__(self) -> Self:
        if _shows_bars():
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._status.stop()

    def __call__(self, event: Event) -> None:
        """Show what happened."""
        match event:
            case StepDone():
                self._positions += 1
                self._status.update(_plain(f"{self._what}: {self._positions} positions"))
            case LightChanged():
                tell_light(event)
            case Noticed(sentence=sentence, kind="warning"):
                warn(sentence)
            case Ready(warnings=warnings):
                for sentence in warnings:
                    warn(sentence)


class Working:
    """Shows how far one long step is, and the time left, on a terminal; call it with the fraction done.

    Parameters
    ----------
    what
        What is being done.
    """

    def __init__(self, what: str) -> None:
        self._bar = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=_bar_width()),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeRemainingColumn(),
            console=err,
            transient=True,
            disable=not _shows_bars(),
        )
        self._what = what
        self._began_s = 0.0
        self._task = self._bar.add_task(printable(what), total=1.0)

    def __enter__(self) -> Self:
        self._began_s = time.monotonic()
        detail(self._what)
        self._bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._bar.stop()
        took = show_duration(time.monotonic() - self._began_s)
        detail(f"{self._what}: {'ended' if kind else 'done'} after {took}")

    def __call__(self, fraction: float) -> None:
        """Show that ``fraction`` of the work is done."""
        self._bar.update(self._task, completed=fraction)
