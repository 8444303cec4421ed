"""What `rig recon` will take, said before it begins; what cannot be, or would take very long, is refused."""

import json
import platform
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import ConfigDict

import rig
from recon import computer
from recon.camera import ConfocalCamera
from recon.effort import Effort, Speed, effort, speed
from recon.imaging import plan
from recon.parts import Cut, cut
from recon.solvers.problem import ImagingProblem, Solver
from rig.atomic import appearing
from rig.errors import RefusedError
from rig.files.scan import ScanFile
from rig.image.focus import ATTEMPTS
from rig.image.request import Request, check, check_elsewhere
from rig.image.work import Work, camera_of, chosen
from rig.model.quantities import show_duration
from rig.whole import read_whole

#: By the clock; what takes longer runs with ``--yes``.
LONGEST_S = 600.0
#: What a cluster of local workers takes to begin and to end, and bytes that it sends in a second.
CLUSTER_S, CLUSTER_BYTES_PER_S = 4.0, 2e8


@dataclass(frozen=True)
class Workers:
    """Processes that compute parts of an image.

    Attributes
    ----------
    number
        How many parts are computed at the same time.
    memory_bytes
        What a part may take.
    """

    number: int
    memory_bytes: int

    @classmethod
    def of_this_computer(cls, number: int, memory_bytes: int | None) -> "Workers":
        """Return workers that have each a share of this computer's memory, unless they are given a bound."""
        return cls(number, memory_bytes or int(computer.memory_bytes() / number / 2))


@dataclass(frozen=True)
class OnWorkers:
    """What an image takes in parts; `rig.commands.documents` describes it by these words, too."""

    __pydantic_config__ = ConfigDict(extra="forbid", use_attribute_docstrings=True)

    workers: int
    """Number of workers, of one thread each."""
    parts: int
    memory_bytes: int
    """Memory that the largest part needs."""
    traffic_bytes: int
    """Size of the spectra and fields that are sent."""
    clock_s: float
    """Estimated duration, with one core for each worker."""


@dataclass(frozen=True)
class Forecast:
    """What imaging takes.

    Attributes
    ----------
    shape
        Voxels along x, y and z.
    effort
        What was counted; None where the solver's work is not counted.
    processor_s, clock_s
        Estimated time here, of one image.
    cores
        Of this computer.
    images
        How many images there may be, where the wavelength is to be found.
    on_workers
        The same, on workers; None where an image is not cut, or was not asked to be.
    """

    shape: tuple[int, int, int]
    effort: Effort | None
    processor_s: float
    clock_s: float
    cores: int
    images: int
    on_workers: OnWorkers | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values."""
        found: dict[str, Any] = {"voxels": self.shape, "cores": self.cores, "images_at_most": self.images}
        if self.effort:
            found |= {key: value for key, value in asdict(self.effort).items() if key != "voxels"}
            found |= {"processor_s": round(self.processor_s, 2), "clock_s": round(self.clock_s, 2)}
        if self.on_workers:
            found["on_workers"] = asdict(self.on_workers)
        return found

    def summary(self) -> dict[str, str]:
        """Return it as a person reads it."""
        width, height, depth = self.shape
        voxels = {"voxels": f"{width} x {height} x {depth}"}
        if self.effort is None:
            return voxels | {"time": "not estimated for this solver"}
        one, workers = self.effort, self.on_workers
        more = f", for each of up to {self.images} images" if self.images > 1 else ""
        found = voxels | {
            "positions": f"{one.positions:,}",
            "frequencies": f"{one.frequencies} at most, {one.pairs:,} pairs of plane and frequency",
            "memory": f"{_size(one.memory_bytes)}, or with --memory {_size(one.least_bytes)} at least",
            "time here": f"{show_duration(self.processor_s)} of processor time{more}; about "
            f"{show_duration(self.clock_s)} by the clock on {self.cores} core{'s' if self.cores > 1 else ''}",
        }
        if workers:
            found["on workers"] = (
                f"about {show_duration(workers.clock_s)} on {workers.workers}: {workers.parts} parts of "
                f"{_size(workers.memory_bytes)} at most, {_size(workers.traffic_bytes)} are sent"
            )
        return found


def _size(count: float) -> str:
    return f"{count / 1e9:.3g} GB" if count >= 1e9 else f"{count / 1e6:.3g} MB"


def forecasted(scan_path: Path, request: Request, workers: int | None = None) -> Forecast:
    """Say what imaging a scan will take; nothing of it is computed.

    Raises
    ------
    As of `rig.image.reconstruct.reconstruct`.
    """
    check(request)
    if workers:
        check_elsewhere(request)
    with ScanFile(scan_path) as scan:
        work, _ = chosen(scan, request)
        shared = Workers.of_this_computer(workers, request.memory_bytes) if workers else None
        return forecast_of(work, shared, measured=True)


def forecast_of(work: Work, workers: Workers | None, *, measured: bool = False) -> Forecast:
    """Count what imaging work takes; all but the work is as of `forecast`."""
    request, camera = work.request, camera_of(work)
    confocal = isinstance(camera, ConfocalCamera)
    searched = confocal and request.wavelength_m is None
    problem = replace(
        plan(work.capture, work.pulse, work.grid, camera, work.window),
        device=request.device,
        slopes=confocal,
    )
    return forecast(
        problem,
        request.solver,
        images=1 + ATTEMPTS if searched else 1,
        workers=workers,
        measured=measured,
    )


def forecast(
    problem: ImagingProblem,
    solver: str | Solver,
    *,
    images: int = 1,
    workers: Workers | None = None,
    measured: bool = False,
) -> Forecast:
    """Count what an image takes, and estimate its time.

    Parameters
    ----------
    problem, solver
        What is imaged, and by what.
    images
        How many images there may be.
    workers
        Who computes parts of it; None where no part is computed elsewhere.
    measured
        Whether the computer's speed is to be known, even if the image is quick at any.
    """
    cores = min(computer.cores(), computer.usual_threads())
    shape = problem.grid.shape[::-1]
    found = effort(problem, solver)
    if found is None:
        return Forecast(shape, None, 0.0, 0.0, cores, images)
    # what is quick anyway needs no measured speed
    here = Speed() if found.clock_s(Speed(), cores) < LONGEST_S / 20 and not measured else this_speed()
    on_workers = None
    if workers and isinstance(solver, str):  # a function of a person's own was not counted
        parts = cut(problem, solver, workers=workers.number, memory_bytes=workers.memory_bytes)
        on_workers = _on_workers(parts, found, here, workers.number)
    return Forecast(
        shape, found, found.processor_s(here), found.clock_s(here, cores), cores, images, on_workers
    )


def _on_workers(parts: Cut, found: Effort, here: Speed, workers: int) -> OnWorkers:
    shared_s = found.processor_s(here) - found.voxels_s * here.record
    clock_s = shared_s / workers + found.voxels_s * here.record
    clock_s += CLUSTER_S + parts.traffic_bytes / CLUSTER_BYTES_PER_S
    return OnWorkers(workers, len(parts.parts), parts.memory_bytes, parts.traffic_bytes, clock_s)


def require_possible(found: Forecast, *, bounded: bool, however_long: bool) -> None:
    """Refuse an image that cannot be, or that would take very long.

    Parameters
    ----------
    found
        What it takes.
    bounded
        Whether it keeps to a bound on memory anyway.
    however_long
        Whether a long time is all right.

    Raises
    ------
    RefusedError
        If so; it says what would do.
    """
    counted = found.effort
    if counted is None:
        return
    room = computer.memory_bytes()
    if found.on_workers is None and not bounded and counted.memory_bytes > room:
        in_turns = f"--memory {0.8 * room / 1e9:.3g}GB computes it in several steps, or "
        raise RefusedError(
            f"imaging takes {_size(counted.memory_bytes)} of memory, but {_size(room)} are here to be used; "
            f"{in_turns if counted.least_bytes < 0.8 * room else ''}image fewer voxels: a larger --voxel, or "
            "a larger step of --depth"
        )
    clock_s = found.on_workers.clock_s if found.on_workers else found.clock_s
    if clock_s > LONGEST_S and not however_long:
        raise RefusedError(
            f"imaging takes about {show_duration(clock_s)}, more than {show_duration(LONGEST_S)}, for "
            f"{counted.pairs:,} pairs of plane and frequency; --yes computes it anyway, "
            "--cluster divides it among workers, and a larger --voxel or step of --depth needs less"
        )


@cache
def this_speed() -> Speed:
    """Return this computer's speed: as it was measured, or measured now and kept."""
    machine = {"host": platform.node(), "cores": computer.cores(), "version": rig.__version__}
    with suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
        stored = json.loads(read_whole(_speed_file()))
        if stored["machine"] == machine:
            return Speed(**stored["speed"])
    found = speed()
    with suppress(OSError), appearing(_speed_file()) as partial:  # kept if the disk allows it
        partial.write_text(json.dumps({"machine": machine, "speed": asdict(found)}), encoding="utf-8")
    return found


def _speed_file() -> Path:
    from rig.light.state import folder

    return folder() / "speed.json"
