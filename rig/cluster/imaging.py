"""Planes of an image, computed by the workers of a cluster.

Each worker reads some positions of the scan file and takes their spectra; each part of the image gets the
spectra that it needs from there, by dask's own way between workers, and its field comes back here. Where
workers do not see the file, spectra are taken here and sent once to each part.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import ceil
from operator import getitem
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import rig
from recon.by_lasers import RUN, Added, runs
from recon.exhaustive import Exhaustive
from recon.noise import Tally
from recon.parts import Cut, Field, Part, Slab, Spectra, cut, readings
from recon.solvers.problem import ImagingProblem, Solver, ignore
from rig.cluster.awaited import awaited
from rig.cluster.stacked import Layer, Task, result, stacked
from rig.cluster.tasks import Stored, Worker, add, fingerprint, focus, introduce, take
from rig.errors import RefusedError
from rig.files.form_counts import chunk_histograms
from rig.files.scan import ScanFile
from rig.image.forecast import Workers

if TYPE_CHECKING:
    from distributed import Client, Future

#: Part of a worker's memory that a part of an image may take: dask moves data to disk from 0.6 on.
SHARE = 0.5
#: Memory of a worker that has no limit.
UNLIMITED_BYTES = 4e9
#: Spectra that are held here at once where workers do not see the file.
HELD_BYTES = 2**30
#: Parts that are sent to each worker before the first comes back.
AHEAD = 3


class Crew:
    """The workers of a cluster, and what they can do.

    Parameters
    ----------
    client
        The cluster.
    memory_bytes
        What a part of an image may take; None takes a share of the worker's own limit.
    files
        Whether workers may read the scan file; otherwise they are sent what they need.

    Raises
    ------
    RefusedError
        If the workers have not this program's version.
    """

    def __init__(self, client: "Client", memory_bytes: int | None = None, *, files: bool = True) -> None:
        self._client, self._files = client, files
        introduced = self._introduced(None)
        versions = {worker.version for worker in introduced}
        if versions != {rig.__version__}:
            raise RefusedError(
                f"workers have rig {', '.join(sorted(versions))}, but this is {rig.__version__}; install the "
                "same on all"
            )
        each_bytes = (SHARE * (one.memory_bytes or UNLIMITED_BYTES) / one.threads for one in introduced)
        #: How many parts they compute at the same time, and what each may take.
        self.workers = Workers(
            sum(one.threads for one in introduced),
            int(min(each_bytes)) if memory_bytes is None else memory_bytes,
        )

    def _introduced(self, path: Path | None) -> list[Worker]:
        try:
            return list(self._client.run(introduce, path).values())
        except ImportError as error:
            raise RefusedError(
                f"the cluster's workers do not have rig ({error}); install nlos-rig {rig.__version__} there"
            ) from error

    def imaging(self, scan: ScanFile, *, changed: bool = False) -> "Shared":
        """Return what computes the fields of a scan; workers read the file if its counts are not changed."""
        stored = self._stored(scan) if self._files and not changed else None
        return Shared(self._client, scan.path.resolve(), stored, self.workers)

    def _stored(self, scan: ScanFile) -> Stored | None:
        """Return the file as workers read it; None where they do not see it, or it is not as it seems."""
        path = scan.path.resolve()
        here = fingerprint(path)
        if scan.growing or scan.mended or {one.sees for one in self._introduced(path)} != {here}:
            return None
        return Stored(path, scan.imaged[0], len(scan.channels), here)


@dataclass(frozen=True)
class Shared:
    """A scan whose fields the workers compute.

    Attributes
    ----------
    client
        The cluster.
    path
        Of the scan file.
    stored
        The file as workers read it; None where they are sent what they need.
    workers
        Who computes them.
    """

    client: "Client"
    path: Path
    stored: Stored | None
    workers: Workers

    def planes(self, problem: ImagingProblem, solver: str | Solver) -> Iterator[Field]:
        """Yield the field of each plane of a capture, in order of depth."""
        assert isinstance(solver, str)  # all others were refused (`check_elsewhere`)
        found = cut(problem, solver, workers=self.workers.number, memory_bytes=self.workers.memory_bytes)
        return self._planes(problem, found, self.stored)

    def runs(self, problem: ImagingProblem, capture: Exhaustive) -> Iterator[Added]:
        """Yield what each run of lasers of an exhaustive capture adds, in their order.

        Raises
        ------
        RefusedError
            If workers do not see the file, which is too large to be sent.
        """
        if self.stored is None:
            raise RefusedError(
                f"the workers do not all see the same {self.path} as this computer: put it where all see it "
                "under the same path, or leave --cluster out"
            )
        return self._added(problem, capture, self.stored)

    def _planes(self, problem: ImagingProblem, found: Cut, stored: Stored | None) -> Iterator[Field]:
        total, so_far = sum(slab.work_s for slab in found.slabs), 0.0

        def done(work_s: float) -> None:
            nonlocal so_far
            so_far += work_s
            problem.progress(min(1.0, so_far / total))

        room = self.workers.number * self.workers.memory_bytes / 2 if stored else HELD_BYTES
        for slabs in _batches(found, problem.capture.positions, room):
            layers = self._read_there(problem, slabs, stored) if stored else self._read_here(problem, slabs)
            yield from stacked(layers, AHEAD * self.workers.number, done)

    def _read_there(self, problem: ImagingProblem, slabs: list[Slab], stored: Stored) -> Iterator[Layer]:
        """Let the workers take the spectra; what they summed up meanwhile is added here."""
        client, wanted = self.client, _wanted(slabs)
        histograms = problem.capture.histograms
        tally = histograms if isinstance(histograms, Tally) else None
        read = readings(problem, wanted, self._readers(problem, wanted, stored), tally)
        taken = [client.submit(take, stored, one, pure=False) for one in read]
        pieces = {
            one.name: [client.submit(getitem, some, number, pure=False) for some in taken]
            for number, one in enumerate(wanted)
        }
        sums = [client.submit(getitem, some, len(wanted), pure=False) for some in taken] if tally else []
        del taken

        def task(part: Part) -> "Callable[[], Future]":
            needed = pieces[part.takes.name]
            return lambda: client.submit(focus, part, *needed, pure=False)

        yield from _layers(slabs, task)
        if tally:
            for one in sums:
                tally.absorb(awaited(one))

    def _read_here(self, problem: ImagingProblem, slabs: list[Slab]) -> Iterator[Layer]:
        """Take the spectra here, and send them with the parts."""
        wanted = _wanted(slabs)
        (reading,) = readings(problem, wanted, [slice(0, problem.capture.positions)])
        found, _ = reading.taken(problem.capture.histograms)
        at = {one.name: spectra for one, spectra in zip(wanted, found, strict=True)}

        def task(part: Part) -> "Callable[[], Future]":
            def submit() -> "Future":
                sent = self.client.scatter(at[part.takes.name], hash=False)
                return self.client.submit(focus, part, sent, pure=False)

            return submit

        yield from _layers(slabs, task)

    def _readers(self, problem: ImagingProblem, wanted: list[Spectra], stored: Stored) -> list[slice]:
        """Divide positions among readers: whole chunks of the file, and no more than their memory holds."""
        positions = problem.capture.positions
        size = sum(_spectra_bytes(problem, one) for one in wanted)
        chunk = chunk_histograms(problem.capture.bins) * stored.channels
        many = max(self.workers.number, ceil(size / (self.workers.memory_bytes / 2)))
        edges = np.linspace(0, ceil(positions / chunk), min(many, ceil(positions / chunk)) + 1)
        cuts = np.minimum(edges.round().astype(int) * chunk, positions).tolist()
        return [slice(first, stop) for first, stop in pairwise(cuts)]

    def _added(self, problem: ImagingProblem, capture: Exhaustive, stored: Stored) -> Iterator[Added]:
        """Let the workers image runs of lasers; few are computed ahead of what is yielded."""
        told, alone = problem.progress, replace(problem, progress=ignore, threads=1)
        longest = max(1, ceil(capture.lasers / (AHEAD * self.workers.number)))
        lasers = list(runs(capture, alone, self.workers.memory_bytes, min(longest, RUN)))
        shared = self.client.scatter(alone, broadcast=True, hash=False)

        def submit(run: slice, problem: Any) -> "Future":
            return self.client.submit(add, stored, run, problem, self.workers.memory_bytes, pure=False)

        waiting: deque[tuple[slice, Future]] = deque()
        source = iter(lasers)
        try:
            while True:
                while len(waiting) < AHEAD * self.workers.number and (run := next(source, None)) is not None:
                    waiting.append((run, submit(run, shared)))
                if not waiting:
                    return
                run, future = waiting.popleft()
                yield result(partial(submit, run, alone), future)
                told(run.stop / capture.lasers)
        finally:
            for _, future in waiting:
                future.cancel()


def _layers(slabs: list[Slab], task: "Callable[[Part], Callable[[], Future]]") -> Iterator[Layer]:
    for slab in slabs:
        yield Layer(slab.shape, tuple(Task(task(part), part.work_s) for part in slab.parts))


def _wanted(slabs: Iterable[Slab]) -> list[Spectra]:
    """Return what spectra slabs need, each once."""
    return list({part.takes.name: part.takes for slab in slabs for part in slab.parts}.values())


def _spectra_bytes(problem: ImagingProblem, one: Spectra) -> int:
    frequencies = len(problem.depth_blocks[one.block].band[one.frequencies])
    return 8 * frequencies * (problem.capture.positions if one.positions is None else len(one.positions))


def _batches(found: Cut, positions: int, room: float) -> Iterator[list[Slab]]:
    """Put slabs together whose spectra fit into the cluster; each batch is a pass over the record."""
    batch: list[Slab] = []
    held: set[tuple[int, int, int]] = set()
    size = 0
    for slab in found.slabs:
        fresh = {part.takes.name: part for part in slab.parts if part.takes.name not in held}
        more = sum(8 * len(p.problem.band) * p.problem.capture.positions for p in fresh.values())
        if batch and size + more > room:
            yield batch
            batch, held, size = [], set(), 0
            more = sum(8 * len(p.problem.band) * p.problem.capture.positions for p in slab.parts)
        batch.append(slab)
        held |= {part.takes.name for part in slab.parts}
        size += more
    if batch:
        yield batch
