"""One method in a process of its own, so that the memory that it takes can be told."""

import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

from recon.capture import Capture
from recon.errors import ReconError
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.noise import quiet_level
from recon.registry import entry_of, name_of
from recon.result import Image
from recon.solvers.classic.solve import baseline_image
from recon.surface import find
from rig.errors import RigError
from rig.files import ScanFile, write_volume
from rig.image.low_pass import low_passed
from rig.image.request import Request
from rig.image.work import Work, chosen

#: Planes that each method images before its time is taken, so that its programs are compiled.
FIRST_PLANES = 2
#: What a job cost, and what is to be said about its image.
Done = tuple[dict[str, float | None], tuple[str, ...]]


@dataclass(frozen=True)
class Job:
    """What a process is told to image.

    Attributes
    ----------
    scan
        A scan file.
    request
        With every choice made, and the solver.
    sigma_s
        Standard deviation of the Gaussian that the record of all but the phasor field is convolved with.
    volume
        Where the volume is written.
    """

    scan: Path
    request: Request
    sigma_s: float
    volume: Path


def in_a_process(job: Job) -> Done | str:
    """Run a job in a process that ends with it, even if this one ends before.

    Returns
    -------
    Done or str
        What it cost and what is to be said, or why there is no image.

    Raises
    ------
    RigError
        As the job does.
    RuntimeError
        If its process failed.
    """
    context = get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_report, args=(job, theirs), daemon=True)
    process.start()
    theirs.close()
    try:
        done: Done | str | RigError = ours.recv()
    except EOFError:
        process.join()
        if process.exitcode is None or process.exitcode > 0:
            raise RuntimeError(
                f"the process of {name_of(job.request.solver)} failed; its messages are above"
            ) from None
        return "its process was ended by the system, probably because of too little memory"
    finally:
        process.terminate()
        process.join()
    if isinstance(done, RigError):
        raise done
    return done


def _report(job: Job, theirs: Connection) -> None:
    done: Done | str | RigError
    try:
        done = _run(job)
    except RigError as error:
        done = error
    with suppress(BrokenPipeError):  # nobody waits any more
        theirs.send(done)


def _run(job: Job) -> Done | str:
    """Image, and write the volume; return what it cost and what to say, or why there is no image."""
    with ScanFile(job.scan) as scan:
        work, _ = chosen(scan, job.request)
        capture = work.capture
        if not entry_of(job.request.solver).virtual_wave:
            capture = low_passed(capture, job.sigma_s)
        before = peak_memory_bytes()
        try:
            _imaged(work, capture, _few_planes(work.grid))
            began_s, busy_s = time.perf_counter(), time.process_time()
            found = _imaged(work, capture, work.grid)
        except ReconError as error:
            return str(error)
        except MemoryError:
            return "there is too little memory for so many voxels"
        costs = {
            "took_s": time.perf_counter() - began_s,
            "processor_s": time.process_time() - busy_s,
            "memory_bytes": peak_memory_bytes(),
            "memory_before_bytes": before,
        }
    # one rule for all images: a surface is what stands out from the image's own quiet part
    write_volume(job.volume, work.volume(found, find(found, quiet_level(found.intensity))))
    return costs, found.notes


def _imaged(work: Work, capture: Capture, grid: VoxelGrid) -> Image:
    solver = work.request.solver
    if entry_of(solver).virtual_wave:
        return image(capture, work.pulse, grid, solver=solver, window=work.window)
    return baseline_image(capture, grid, solver=name_of(solver), window=work.window)


def _few_planes(grid: VoxelGrid) -> VoxelGrid:
    middle = len(grid.z_m) // 2
    return VoxelGrid(grid.x_m, grid.y_m, grid.z_m[middle : middle + FIRST_PLANES])


def peak_memory_bytes() -> int | None:
    """Return the most memory that this process has held; None where the system does not tell.

    Linux tells it for the program alone in /proc; what getrusage tells there begins with the memory of the
    process that started this one.
    """
    status = Path("/proc/self/status")
    if status.exists():
        line = next(
            line for line in status.read_text(encoding="utf-8").splitlines() if line.startswith("VmHWM")
        )
        return int(line.split()[1]) * 1024
    if sys.platform == "win32":
        return None
    import resource

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else most * 1024
