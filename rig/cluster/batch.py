"""Many images, one after the other or on a cluster, with a record from which a killed batch goes on.

The record, ``batch.jsonl`` in the folder of the results, has a line for each thing that happened: an image
begun, done or failed. Lines are added and put on disk one by one, so that a killed program leaves at most
half a line, which is not read. An image that is done, of the same scan, settings and version, is kept.
"""

import json
import os
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recon.errors import ReconError
from rig.atomic import refusals_told, remove_unfinished
from rig.cluster.awaited import GONE, as_done, awaited
from rig.cluster.jobs import Job
from rig.cluster.tasks import fingerprint
from rig.errors import DataFileError, RefusedError, RigError, UsageError, reason
from rig.files.inspection import inspect, inspected_elsewhere
from rig.whole import read_whole

if TYPE_CHECKING:
    from distributed import Client, Future

RECORD = "batch.jsonl"
#: What it may have: an image takes one or two kilobytes each time it is made; a batch has 100,000 at most.
MOST_RECORD_BYTES = 1_000_000_000


@dataclass(frozen=True)
class Outcome:
    """What came of a job.

    Attributes
    ----------
    name
        The job's.
    status
        "done", "kept" from an earlier run, or "failed".
    took_s
        By the clock.
    found
        What is said of the image, as `rig.image.result.Result.as_dict`; of a failure its error and exit code.
    """

    name: str
    status: str
    took_s: float = 0.0
    found: dict[str, Any] = field(default_factory=dict)


class Record:
    """What happened to the jobs of a folder.

    Parameters
    ----------
    folder
        Where results are.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._path = folder, folder / RECORD
        self._last: dict[str, dict[str, Any]] = {}
        try:
            text = read_whole(self._path, MOST_RECORD_BYTES) if self._path.exists() else b""
        except OSError as error:
            raise DataFileError(
                f"{self._path} cannot be read ({reason(error)}); choose another --out"
            ) from error
        for line in text.split(b"\n"):
            try:
                entry = json.loads(line)
                self._last[entry["name"]] = entry
            except (ValueError, KeyError, TypeError, RecursionError):
                continue  # half a line of a killed program; what it would have said is not there
        self._broken = bool(text) and not text.endswith(b"\n")

    def kept(self, job: Job) -> Outcome | None:
        """Return what came of a job earlier, if it is done and its files are as they were left."""
        entry = self._last.get(job.name, {})
        if entry.get("status") != "done" or entry.get("key") != job.key:
            return None
        if [_size(path) for path in job.files(self._folder)] != entry.get("sizes"):
            return None
        found = entry.get("found")
        return Outcome(job.name, "kept", 0.0, found) if isinstance(found, dict) else None

    def require_own(self, jobs: Iterable[Job]) -> None:
        """Refuse to replace files that no job of this record made.

        Raises
        ------
        UsageError
            If there are any.
        """
        for job in jobs:
            taken = [path for path in job.files(self._folder) if os.path.lexists(path)]
            if taken and job.name not in self._last:
                raise UsageError(
                    f"{taken[0]} exists, and is not in {self._path}; move it away, or choose another --out"
                )

    def add(self, job: Job, status: str, outcome: Outcome | None = None) -> None:
        """Put a line on disk."""
        entry: dict[str, Any] = {"name": job.name, "key": job.key, "status": status, "scan": str(job.scan)}
        entry["settings"] = dict(job.settings)
        if outcome:
            for path in job.files(self._folder):
                remove_unfinished(path)  # of a worker that was killed
            entry |= {"took_s": round(outcome.took_s, 2), "found": outcome.found}
            entry["sizes"] = [_size(path) for path in job.files(self._folder)]
        self._last[job.name] = entry
        line = ("\n" if self._broken else "") + json.dumps(entry, default=str) + "\n"
        self._broken = False
        with refusals_told(self._path), open(self._path, "ab") as file:
            file.write(line.encode())
            file.flush()
            os.fsync(file.fileno())


def run(
    jobs: list[Job], folder: Path, client: "Client | None" = None, command: tuple[str, ...] = ()
) -> Iterator[Outcome]:
    """Make the images that are not there yet; yield what came of each job as it is known.

    Parameters
    ----------
    jobs
        What to make.
    folder
        Where results go; it is made if it is missing.
    client
        The cluster; None computes here, one image after the other.
    command
        What was typed, for the volume files.

    Raises
    ------
    UsageError
        If the folder cannot be made, or holds files of these names that no batch made.
    DataFileError
        If the record cannot be read or written.
    RefusedError
        If the workers do not see the files.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"cannot create the folder {folder} ({reason(error)}); give another --out"
        ) from error
    record = Record(folder)
    outcomes = {job.name: record.kept(job) for job in jobs}
    yield from (one for one in outcomes.values() if one)
    to_do = [job for job in jobs if outcomes[job.name] is None]
    record.require_own(to_do)
    done = _here(to_do, folder, record) if client is None else _there(client, to_do, folder, command, record)
    for job, outcome in done:
        record.add(job, outcome.status, outcome)
        yield outcome


def _here(jobs: list[Job], folder: Path, record: Record) -> Iterator[tuple[Job, Outcome]]:
    for job in jobs:
        record.add(job, "begun")
        yield job, image(job, folder, ())


def _there(
    client: "Client", jobs: list[Job], folder: Path, command: tuple[str, ...], record: Record
) -> Iterator[tuple[Job, Outcome]]:
    folder = folder.resolve()
    _require_seen(client, {job.scan for job in jobs}, folder)
    sent: dict[Future, Job] = {}
    for job in jobs:
        try:
            inspect(job.scan)
        except DataFileError as refused:
            yield job, _failed(job, refused, 0.0)
            continue
        record.add(job, "begun")
        sent[client.submit(image, job, folder, command, pure=False)] = job
    for future in as_done(list(sent), client):
        if future.cancelled():
            raise RefusedError(GONE)
        job, error = sent.pop(future), future.exception()
        yield job, awaited(future) if error is None else _failed(job, error, 0.0)


def _require_seen(client: "Client", scans: set[Path], folder: Path) -> None:
    """Refuse workers that do not see scans or results."""
    here = _sights(sorted(scans), folder)
    for worker, there in client.run(_sights, sorted(scans), folder).items():
        if there != here:
            raise RefusedError(
                f"the worker {worker} does not see the same files as this computer: a batch needs scans and "
                f"{folder} on a file system that all share"
            )


def _sights(scans: list[Path], folder: Path) -> list[Any]:
    return [*map(fingerprint, scans), folder.is_dir()]


def image(job: Job, folder: Path, command: tuple[str, ...]) -> Outcome:
    """Make one image; what goes wrong with it is its outcome."""
    from rig.image.drawing import Drawing
    from rig.image.reconstruct import reconstruct

    if command:  # in a worker: its own words say nothing
        sys.argv = [*command]
        _compute_alone(job)
    began_s = time.monotonic()
    try:
        volume, picture = job.files(folder)
        result = reconstruct(job.scan, job.request, volume, Drawing(picture))
    except Exception as error:
        return _failed(job, error, time.monotonic() - began_s)
    return Outcome(job.name, "done", time.monotonic() - began_s, result.as_dict())


def _compute_alone(job: Job) -> None:
    """Take one thread, and the scan as looked through: who sent the job did so."""
    from numba import set_num_threads

    set_num_threads(1)
    inspected_elsewhere(job.scan)


def _failed(job: Job, error: BaseException, took_s: float) -> Outcome:
    codes = ((RigError, getattr(error, "exit_code", 1)), (ReconError, 2), (MemoryError, 4), (OSError, 2))
    code = next((code for kind, code in codes if isinstance(error, kind)), 1)
    words = str(error) if code != 1 else f"{type(error).__name__}: {error}; this is a defect in rig"
    return Outcome(job.name, "failed", took_s, {"error": words, "exit_code": code})


def _size(path: Path) -> int | None:
    try:
        return path.stat().st_size
    except OSError:
        return None
