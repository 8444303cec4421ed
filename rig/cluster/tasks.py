"""What workers are asked to do: functions of their arguments alone, so that a lost one is simply repeated."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rig
from recon.by_lasers import Added, of_run
from recon.parts import Field, Part, Reading
from recon.solvers.problem import ImagingProblem
from rig.errors import DataFileError
from rig.files.inspection import inspected_elsewhere
from rig.files.scan import ScanFile


@dataclass(frozen=True)
class Worker:
    """What a worker says of itself.

    Attributes
    ----------
    version
        Of this program.
    threads
        How many tasks it does at the same time.
    memory_bytes
        What it may take; None where it has no limit.
    sees
        Size and time of the file it was asked for, as `fingerprint`.
    """

    version: str
    threads: int
    memory_bytes: int | None
    sees: tuple[int, int] | None


def introduce(path: Path | None, dask_worker: Any) -> Worker:
    """Say what this worker is, and whether it sees a file."""
    limit = dask_worker.memory_manager.memory_limit
    return Worker(rig.__version__, dask_worker.state.nthreads, limit or None, fingerprint(path))


def fingerprint(path: Path | None) -> tuple[int, int] | None:
    """Return size and time of a file, which tell it from others of its name; None where there is none."""
    try:
        stat = os.stat(path) if path else None
    except OSError:
        return None
    return (stat.st_size, stat.st_mtime_ns) if stat else None


@dataclass(frozen=True)
class Stored:
    """Counts in a scan file that workers see.

    Attributes
    ----------
    path
        Where it is.
    steps
        The steps that are imaged.
    channels
        Pairs of a step.
    seen
        Its `fingerprint` when it was looked through.
    """

    path: Path
    steps: NDArray[np.int64]
    channels: int
    seen: tuple[int, int] | None


def take(stored: Stored, reading: Reading) -> list[Any]:
    """Read some positions; return their spectra piece by piece, and last what summed up their counts."""
    run = reading.positions
    steps = stored.steps[run.start // stored.channels : run.stop // stored.channels]
    with _opened(stored) as scan:
        found, tally = reading.taken(scan.histograms_of(steps))
    return [*found, tally]


def add(stored: Stored, lasers: slice, problem: ImagingProblem, memory_bytes: int) -> Added:
    """Image a run of lasers of an exhaustive capture."""
    from numba import set_num_threads

    set_num_threads(1)
    with _opened(stored) as scan:
        capture = scan.exhaustive()
        assert capture is not None  # it was, and the file is the same
        return of_run(capture.block(lasers), problem, memory_bytes)


def _opened(stored: Stored) -> ScanFile:
    """Open a file that the client looked through, unless it is another one now."""
    if fingerprint(stored.path) != stored.seen:
        raise DataFileError(f"{stored.path} was changed while it was imaged; image it again")
    inspected_elsewhere(stored.path)
    return ScanFile(stored.path)


def focus(part: Part, *pieces: Field) -> Field:
    """Compute a part from the spectra of its positions, which come in pieces."""
    from numba import set_num_threads

    set_num_threads(1)
    return part.field(np.concatenate(pieces, axis=1))
