"""Work shared among all cores, for batches only: a bench draws its photons in one thread."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor


def parallel_for(work: Callable[[int], object], number: int) -> None:
    """Call ``work`` with 0 to ``number`` - 1, in any order; it helps where kernels release the GIL."""
    workers = os.cpu_count() or 1

    def share(first: int) -> None:
        for index in range(first, number, workers):
            work(index)

    with ThreadPoolExecutor(workers) as pool:
        for done in [pool.submit(share, first) for first in range(workers)]:
            done.result()
