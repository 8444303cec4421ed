"""Waiting for what a cluster computes, as long as there is somebody who computes it.

Dask waits for ever where its last worker is gone, since another may come, or where its scheduler is silent.
"""

import time
from collections.abc import Collection, Iterator
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from rig.errors import RefusedError

if TYPE_CHECKING:
    from distributed import Client, Future

#: While nothing comes, the cluster is looked at so often [s].
LOOK_S = 2.0
#: So long there may be no worker, since a batch system may start others, and no word of a busy scheduler [s].
LONGEST_S = 300.0
GONE = "the connection to the cluster's scheduler was lost; start it, and run the same command again"


def awaited(future: "Future") -> Any:
    """Return what a task gives.

    Raises
    ------
    RefusedError
        If the scheduler is gone or silent, or no worker has come for a while.
    asyncio.CancelledError
        If data that it needs went with a worker.
    """
    next(as_done([future], future.client))
    if future.cancelled() and future.client.status != "running":
        raise RefusedError(GONE)
    return future.result()


def as_done(futures: "Collection[Future]", client: "Client") -> "Iterator[Future]":
    """Yield tasks as they are done, failed or cancelled; raises RefusedError as `awaited` does."""
    done: SimpleQueue[Future] = SimpleQueue()
    for future in futures:
        future.add_done_callback(done.put)
    looks = _Looks(client)
    for _ in futures:
        found = None
        while found is None:
            with suppress(Empty):
                found = done.get(timeout=LOOK_S)
            if found is None:
                looks.again()
        yield found


class _Looks:
    """Looks at a cluster from which nothing comes.

    Parameters
    ----------
    client
        The cluster.
    """

    def __init__(self, client: "Client") -> None:
        self._client = client
        self._trouble, self._since_s = "", 0.0

    def again(self) -> None:
        """Look once more; raise RefusedError if nothing is to be waited for."""
        if self._client.status != "running":
            raise RefusedError(GONE)
        trouble, remedy = self._seen()
        now_s = time.monotonic()
        if trouble != self._trouble:
            self._trouble, self._since_s = trouble, now_s
        if trouble and now_s - self._since_s >= LONGEST_S:
            raise RefusedError(
                f"the cluster {trouble} for {LONGEST_S:g} s; {remedy}, and run the same command again"
            )

    def _seen(self) -> tuple[str, str]:
        """Return what is wrong, and what helps."""
        try:
            workers = self._client.sync(self._client.scheduler.ncores, callback_timeout=LOOK_S)  # type: ignore[union-attr]
        except (OSError, TimeoutError):
            return "has a scheduler that did not answer", "look at it"
        return ("", "") if workers else ("has had no worker", "start some: dask worker")
