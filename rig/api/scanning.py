"""Scans planned and run by Python programs."""

import os
import threading
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from rig.acquire import acquisition
from rig.acquire.acquisition import ScanResult, Watch
from rig.acquire.connect import open_devices
from rig.acquire.events import Consumer, Event, Grown, Outcome, StepDone
from rig.acquire.interrupt import StopRequest
from rig.acquire.preflight import Estimate, check
from rig.api import html
from rig.api.scans import Scan
from rig.errors import InterruptedScanError, RefusedError, UsageError, refuse_folder
from rig.files.taken import is_scan
from rig.image.until import Rule, Until
from rig.light.state import require_no_trip
from rig.light.words import light_in_words
from rig.model import asked
from rig.model.config import load
from rig.model.devices import Operator
from rig.model.plan import ScanPlan
from rig.model.quantities import show, show_duration
from rig.model.state import RigState

if TYPE_CHECKING:
    from rig.model.config import RigConfig

#: A configuration: a file, the tables of one, or None for the built-in simulated rig.
Config = str | os.PathLike[str] | Mapping[str, Any] | None
Quantity = str | float


class PlanOptions(TypedDict, total=False):
    """What may be asked of a scan, as of `rig.plan`."""

    config: Config
    exposure: Quantity | None
    grid: str | tuple[int, int] | None
    spacing: Quantity | None
    mode: Literal["step", "continuous"]
    frames: int | Literal["until-stopped"] | None
    order: Literal["raster", "unidirectional", "progressive", "random"]
    preset: str | None
    scene: str | None
    place: str | tuple[float, float, float] | None
    rotate: str | tuple[float, float, float] | None
    scale: float | None
    seed: int | None
    notes: Mapping[str, str] | None


@dataclass(frozen=True)
class Plan:
    """What is measured, and on what rig; `rig.plan` makes it. Nothing in it changes.

    Attributes
    ----------
    plan
        Positions, exposure and order.
    state
        The rig: configuration and calibrations.

    Examples
    --------
    >>> plan = rig.plan(grid="24x18", spacing="8cm")
    >>> plan
    <rig.Plan: 24 x 18 positions 8 cm apart, 10 ms each, step>
    >>> plan.positions_m.shape
    (432, 3)
    >>> plan.estimate().duration_s < 60
    True
    """

    plan: ScanPlan
    state: RigState

    @property
    def config(self) -> "RigConfig":
        """The rig's configuration."""
        return self.state.config

    @property
    def positions_m(self) -> NDArray[np.float64]:
        """(S, 3) laser spot of each step, in order."""
        return self.plan.spots_m

    def estimate(self, folder: str | os.PathLike[str] = ".") -> Estimate:
        """Hold it against the rig and the disk, and say how much it is; no device is touched.

        Parameters
        ----------
        folder
            Where the scan file shall be.

        Raises
        ------
        rig.errors.RefusedError
            If the rig cannot do it, or the disk is too small.
        drivers.errors.LimitError
            If a device cannot be set so.
        """
        return check(self.plan, self.state, Path(folder))

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.plan)

    def __repr__(self) -> str:
        return f"<rig.Plan: {self.plan.in_words()}>"

    def _repr_html_(self) -> str:
        light = show_duration(self.plan.exposure_total_s)
        facts = {"rig": self.config.name, "plan": self.plan.in_words(), "light": light}
        return html.table("Plan", facts)


def plan(
    config: Config = None,
    *,
    exposure: Quantity | None = None,
    grid: str | tuple[int, int] | None = None,
    spacing: Quantity | None = None,
    mode: Literal["step", "continuous"] = "step",
    frames: int | Literal["until-stopped"] | None = None,
    order: Literal["raster", "unidirectional", "progressive", "random"] = "raster",
    preset: str | None = None,
    scene: str | None = None,
    place: str | tuple[float, float, float] | None = None,
    rotate: str | tuple[float, float, float] | None = None,
    scale: float | None = None,
    seed: int | None = None,
    notes: Mapping[str, str] | None = None,
) -> Plan:
    """Plan a scan. Names and defaults are those of the options of `rig scan`.

    Parameters
    ----------
    config
        A configuration file, or its tables as a dictionary, in which quantities are text as in a file; None
        is the built-in simulated rig.
    exposure
        Measurement time at each position, ``"10ms"`` or ``0.01``.
    grid, spacing
        Columns and rows, ``"24x18"`` or ``(24, 18)``, and the distance between positions.
    mode, frames, order
        How the mirror moves, how often it visits all positions, and in which order.
    preset, scene, seed
        For the simulated rig: a dataset of the paper, what is hidden, and the seed of the photons.
    place, rotate, scale
        Of a scene that is a mesh file: its middle, ``"0cm,0cm,1.2m"`` or ``(0, 0, 1.2)``; turns about x, y
        and z, ``"0deg,90deg,0deg"`` or in radians; and by what its coordinates are multiplied.
    notes
        ``operator``, ``sample``, ``purpose`` and ``note``, kept in the scan file.

    Raises
    ------
    rig.errors.UsageError
        If something cannot be understood.
    rig.errors.ConfigError
        If the configuration is missing or wrong.
    """
    simulation = {"scene": scene, "seed": seed, **asked.placement(place, rotate, scale)}
    source = config if config is None or isinstance(config, Mapping) else os.fspath(config)
    found = asked.configuration(source, preset, simulation, notes)
    state = RigState.resolve(found)
    measured = asked.plan(
        found, exposure=exposure, grid=grid, spacing=spacing, mode=mode, frames=frames, order=order
    )
    return Plan(measured, state)


@dataclass(frozen=True)
class Progress:
    """How far a scan is.

    Attributes
    ----------
    done, steps
        Steps measured, and planned.
    photons
        Counted by this run.
    live_time_s
        Measured by this run.
    """

    done: int
    steps: int
    photons: int
    live_time_s: float

    @property
    def fraction(self) -> float:
        """Part of the steps that is measured."""
        return self.done / self.steps

    @property
    def rate_hz(self) -> float:
        """Photons a second of measurement."""
        return self.photons / self.live_time_s if self.live_time_s else 0.0

    def __str__(self) -> str:
        return f"{self.done:,} of {self.steps:,} positions, {show(self.rate_hz, 'photons/s')}"


#: Called after each step; what returns True ends the scan, which can be resumed.
Callback = Callable[[Progress], object]


def scan(
    path: str | os.PathLike[str],
    plan: Plan | None = None,
    *,
    progress: Callback | None = None,
    until: str | None = None,
    consent: bool = False,
    devices: Mapping[str, Any] | None = None,
    operator: Operator | None = None,
    **options: Unpack[PlanOptions],
) -> Scan:
    """Measure, and open the scan file.

    A laser that is not simulated is class 4, and is lit only with ``consent=True``: goggles on, doors closed,
    nobody in the beam's way. Ctrl-C and an exception in ``progress`` end a scan as they end `rig scan`: the
    laser goes dark first, and what was measured is safe.

    Parameters
    ----------
    path
        The scan file to make.
    plan
        What is measured; None plans it with ``options``, as `rig.plan` does.
    progress
        Called after each step; if it returns True, the scan ends after that step.
    until
        A rule that ends the scan, e.g. ``"time 60s"``, as of `rig scan --until`.
    consent
        Whether a person wants the light of a real laser now.
    devices
        Devices of your own in place of those of the configuration, by role: ``galvo``, ``detector``,
        ``tcspc``, ``point_clock``. Each is a context manager with what `rig.model.devices` asks of its role.
        A laser is none of these: its guard opens it in a process of its own, see docs/plug-ins.md.
    operator
        Who sets by hand what has no data interface; see `rig.model.devices.Operator`.
    **options
        As of `rig.plan`.

    Returns
    -------
    Scan
        Open for reading.

    Raises
    ------
    rig.errors.RefusedError
        If the rig cannot do it, consent is missing, or a trip was not acknowledged; nothing was lit.
    rig.errors.UsageError
        If the file exists, or something cannot be understood.
    rig.errors.InterruptedScanError
        If Ctrl-C stopped it; what was measured is safe, and `rig.resume` goes on.
    drivers.errors.DeviceError
        If a device fails; what was measured is safe.

    Examples
    --------
    >>> with rig.scan("small.h5", grid="4x3", spacing="30cm", exposure="1ms") as scan:
    ...     scan.status, len(scan)
    ('complete', 12)
    """
    if plan is not None and options:
        raise UsageError(
            f"a plan is given, so that {', '.join(options)} would have no effect; give it to rig.plan"
        )
    target, chosen = Path(path), plan if plan is not None else _planned(options)
    refuse_folder(target)
    if os.path.lexists(target):
        named = "is a scan, and is" if is_scan(target) else "exists and is"
        raise UsageError(f"{target} {named} not overwritten; give another name, or move it away")
    chosen.estimate(target.parent)
    _require_consent(chosen.config, consent)

    def run(watch: Watch) -> ScanResult:
        tagged = chosen.plan.continuous
        with open_devices(chosen.config, tagged=tagged, operator=operator, own=devices) as opened:
            state = chosen.state.of_devices(opened.identities())
            return acquisition.record(chosen.plan, state, opened, target, watch, operator)

    return _ran(run, chosen.plan, target, progress, until)


def resume(
    path: str | os.PathLike[str],
    config: str | os.PathLike[str] | None = None,
    *,
    progress: Callback | None = None,
    until: str | None = None,
    consent: bool = False,
    devices: Mapping[str, Any] | None = None,
    operator: Operator | None = None,
) -> Scan:
    """Resume an interrupted scan where it stopped, with the plan that its file holds, and open it.

    Parameters
    ----------
    path
        The scan file.
    config
        The rig's configuration file; not needed where the scan was simulated.
    progress, until, consent, devices, operator
        As of `rig.scan`.

    Raises
    ------
    As `rig.scan`; and `rig.errors.DataFileError` if the file is damaged.
    """
    target = Path(path)
    held, state = acquisition.interrupted(target, load(Path(config)) if config else None)
    check(held, state, target.parent)
    _require_consent(state.config, consent)

    def run(watch: Watch) -> ScanResult:
        return acquisition.resume(held, state, target, watch, operator, devices)

    return _ran(run, held, target, progress, until, resumed=True)


def _planned(options: PlanOptions) -> Plan:
    return plan(**options)


def _require_consent(config: "RigConfig", consent: bool) -> None:
    """Refuse to light a real laser unless a person wants it, and no trip is open."""
    if config.simulated:
        return
    require_no_trip(config)
    if not consent:
        raise RefusedError(
            f"this lights {light_in_words(config)}. Goggles on, doors closed, "
            "nobody in the path of the beam? Then confirm it with consent=True"
        )


@dataclass
class _Looker:
    """A consumer of events that reports progress, and keeps whether the scan is to end."""

    callback: Callback | None
    steps: int
    done: int = 0
    photons: int = 0
    live_time_s: float = 0.0
    stop: str = field(default="", init=False)

    def __call__(self, event: Event) -> None:
        match event:
            case Grown(plan=plan):
                self.steps = len(plan)
            case StepDone(step=step, exposure=exposure):
                self.done = step.index + 1
                self.photons += exposure.photons
                self.live_time_s += exposure.live_time_s
                if self.callback is not None and self._report() is True:
                    self.stop = "stopped by its progress callback"

    def _report(self) -> object:
        assert self.callback is not None
        return self.callback(Progress(self.done, self.steps, self.photons, self.live_time_s))


def _ran(
    run: Callable[[Watch], ScanResult],
    plan: ScanPlan,
    target: Path,
    progress: Callback | None,
    until: str | None,
    *,
    resumed: bool = False,
) -> Scan:
    """Run a scan while others look on, and open its file."""
    looker = _Looker(progress, len(plan))
    rule = Until(Rule.from_text(until, plan)) if until else None
    if rule is not None and resumed:
        with Scan(target) as held:
            rule.take_up(held.file)
    with _stoppable() as stopped:

        def should_stop() -> bool | str:
            return looker.stop or (rule.reason() if rule else "") or stopped()

        consumers: list[Consumer] = [looker] if rule is None else [looker, rule]
        begun = rule.begun if rule else (lambda description: None)
        result = run(Watch(consumers, should_stop, begun))
    asked_for = plan.endless or result.ended.reason in (looker.stop, rule.reason() if rule else None)
    if result.ended.outcome is not Outcome.COMPLETE and not asked_for:
        raise InterruptedScanError(
            f"{target}: the scan was stopped. {result.ended.steps_done:,} of {len(plan):,} positions are "
            f"safe in the file. Continue with: rig.resume({str(target)!r})"
        )
    return Scan(target)


def _stoppable() -> AbstractContextManager[Callable[[], bool | str]]:
    """Take Ctrl-C as a wish to stop; signals reach the main thread alone."""
    if threading.current_thread() is threading.main_thread():
        return StopRequest(lambda sentence: None)
    return nullcontext(lambda: False)
