"""Arrays that many tasks give, put together: what belongs to the same planes adds up, and planes stack.

It knows nothing of images: a task is what submits itself, and gives an array.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.cluster.awaited import awaited
from rig.errors import RefusedError

if TYPE_CHECKING:
    from distributed import Future

#: So often a task whose data were lost is sent again.
ATTEMPTS = 4


@dataclass(frozen=True)
class Task:
    """A task.

    Attributes
    ----------
    submit
        Sends it to the cluster.
    work
        How long it takes beside others.
    """

    submit: "Callable[[], Future]"
    work: float


@dataclass(frozen=True)
class Layer:
    """Planes whose values are the sum of what tasks give; zero without tasks."""

    shape: tuple[int, ...]
    tasks: tuple[Task, ...]


def stacked(
    layers: Iterable[Layer], ahead: int, done: Callable[[float], None]
) -> Iterator[NDArray[np.complexfloating]]:
    """Yield planes in order, as tasks complete.

    Parameters
    ----------
    layers
        In order; they are made as they are needed.
    ahead
        How many tasks are sent before the first of them is awaited; their results wait at the workers.
    done
        Called with the work of each task that is done.

    Raises
    ------
    RefusedError
        If a task took worker after worker down.
    """
    waiting: deque[tuple[Layer, list[tuple[Task, Future]]]] = deque()
    sent = 0
    source = iter(layers)
    try:
        while True:
            while sent < ahead and (layer := next(source, None)) is not None:
                waiting.append((layer, [(task, task.submit()) for task in layer.tasks]))
                sent += len(layer.tasks)
            if not waiting:
                return
            layer, tasks = waiting.popleft()
            total: NDArray[np.complexfloating] | None = None
            while tasks:
                task, future = tasks.pop(0)
                found = result(task.submit, future)
                total = found if total is None else _added(total, found)
                sent -= 1
                done(task.work)
            yield from np.zeros(layer.shape, np.complex64) if total is None else total
    finally:
        for _, tasks in waiting:
            for _, future in tasks:
                future.cancel()


def _added(
    total: NDArray[np.complexfloating], found: NDArray[np.complexfloating]
) -> NDArray[np.complexfloating]:
    total = total if total.flags.writeable else total.copy()
    total += found
    return total


def result(submit: "Callable[[], Future]", future: "Future") -> Any:
    """Return what a task gives; data that went with a worker are sent once more, by `submit`.

    Raises
    ------
    RefusedError
        If it took worker after worker down.
    """
    from distributed import KilledWorker

    for attempt in range(ATTEMPTS):
        try:
            return awaited(future)
        except KilledWorker as error:
            raise RefusedError(
                f"the cluster gave up a part of the image: {ATTEMPTS} workers ended while they computed it "
                f"({error}). Most often their memory is too small: give a lower --memory, or larger workers"
            ) from error
        except (asyncio.CancelledError, futures.CancelledError):
            if attempt + 1 == ATTEMPTS:
                raise RefusedError(
                    f"the cluster lost the data that it was sent {ATTEMPTS} times; "
                    "check that its workers keep running"
                ) from None
            future = submit()
    raise AssertionError("unreachable")
