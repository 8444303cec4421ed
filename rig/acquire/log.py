"""The log beside a scan: what happened and when, in plain text, a line an event."""

from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from rig.acquire.events import (
    Ended,
    Event,
    Grown,
    LightChanged,
    LineDone,
    Noticed,
    PhaseChanged,
    Ready,
    StepCut,
    StepDone,
)
from rig.errors import command_line
from rig.model.plan import ScanPlan
from rig.model.quantities import show


def log_of(scan: Path) -> Path:
    """Return the name of the log of a scan file."""
    return scan.with_name((scan.name if scan.suffix == ".log" else scan.stem) + ".log")


class ScanLog:
    """A consumer of scan events that writes them to a text file as they happen; use as a context manager.

    A log that cannot be written is missed, but stops no scan.

    Parameters
    ----------
    path
        The text file; what a scan that is taken up again wrote before stays in it.
    plan
        What is measured.
    first
        Step at which it begins.
    """

    def __init__(self, path: Path, plan: ScanPlan, first: int) -> None:
        self.path = path
        self._plan = plan
        self._first = first
        self._step = first
        self._file: IO[str] | None = None
        self._begun: dict[str, int] = {}  # warnings that go on, and the step at which each began
        self._last: dict[str, int] = {}

    def __enter__(self) -> Self:
        with suppress(OSError):
            self._file = self.path.open("a", buffering=1, encoding="utf-8")
        self._say(f"{'resumed' if self._first else 'started'} by: {command_line() or 'a Python program'}")
        self._say(f"plan: {len(self._plan)} positions, from {self._first} on; {self._plan.model_dump_json()}")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self._say(f"{type(error).__name__}: {error}")
        file, self._file = self._file, None
        if file is not None:
            with suppress(OSError):
                file.close()

    def __call__(self, event: Event) -> None:
        """Write what happened."""
        match event:
            case PhaseChanged(phase=phase):
                self._say(phase.value)
            case Ready(pass_index=number, rates=rates, warnings=warnings, settings=settings):
                self._say(f"pass {number}, from position {self._step} on")
                for name, said in settings.items():
                    self._say(f"{name}: {', '.join(f'{key} {value}' for key, value in said.items())}")
                self._say(f"sync {show(rates.sync_hz, 'Hz')}, {show(rates.input_hz, 'counts/s')}")
                self._warn(self._step, warnings)
            case StepDone(step=step, exposure=exposure):
                self._step = step.index + 1
                self._warn(step.index, exposure.warnings)
            case StepCut(step=step, exposure=exposure):
                self._say(f"position {step.index} ended early after {exposure.live_time_s:g} s")
            case LightChanged() | Noticed():
                self._say(_in_words(event))
            case LineDone(steps_done=done):
                self._say(f"{done} of {len(self._plan)} positions measured")
            case Grown(plan=plan):
                self._plan = plan
                self._say(f"{plan.frames} frames are planned now")
            case Ended(outcome=outcome, steps_done=done, reason=reason):
                self._end_of_warnings(set())
                self._say(f"{outcome.value} after {done} of {len(self._plan)} positions: {reason}")

    def _warn(self, step: int, warnings: tuple[str, ...]) -> None:
        """Write warnings where they begin, and where they end."""
        self._end_of_warnings(set(warnings))
        for sentence in warnings:
            if sentence not in self._begun:
                self._say(f"warning from position {step} on: {sentence}")
                self._begun[sentence] = step
            self._last[sentence] = step

    def _end_of_warnings(self, still: set[str]) -> None:
        for sentence in [one for one in self._begun if one not in still]:
            first, last = self._begun.pop(sentence), self._last.pop(sentence)
            self._say(f"warning of positions {first} to {last} ended: {sentence}")

    def _say(self, what: str) -> None:
        if self._file is not None:
            when = datetime.now(UTC).isoformat(timespec="milliseconds")
            with suppress(OSError, ValueError):
                self._file.write(f"{when} {' '.join(what.split())}\n")


def _in_words(event: LightChanged | Noticed) -> str:
    if isinstance(event, LightChanged):
        return event.words
    return f"positions {event.first} to {event.last}: {event.sentence}"
