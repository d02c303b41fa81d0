"""One function over many items: in this process, on all cores of the machine, or on a cluster.

Where it runs changes nothing in the results: they come in the order of the items, each once, and
what the function raises for an item is raised in its turn. A worker may be killed at any time;
the items it had are run again.
"""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass
from itertools import chain, islice
from types import TracebackType
from typing import Generic, Protocol, Self, TypeVar

from classify.errors import InputError

__all__ = ["Batch", "Pool"]

# A worker process is of use this long after it is started: it has to import numba, scipy and
# OpenCV (1.4 s measured, 2 s with a worker on each core). What takes no longer in all is done
# sooner without.
STARTING_S = 2.0

Item = TypeVar("Item")
Result = TypeVar("Result")


class Pool(Protocol):
    """Workers, behind the futures of `concurrent.futures`.

    `workers` items run at a time, `in_flight` keep them busy. The future of an item whose worker
    died raises one of `died`; after `attempts` of that the item is given up.
    """

    workers: int
    in_flight: int
    attempts: int
    died: tuple[type[Exception], ...]

    def submit(self, function: Callable[[Item], Result], item: Item) -> Future[Result]:
        """Have a worker call the function."""

    def renew(self) -> None:
        """Begin again with living workers; what was submitted is forgotten."""

    def close(self) -> None:
        """Let the workers go; they have nothing to do."""

    def abort(self) -> None:
        """Interrupt what is running and let the workers go."""


class Batch:
    """Calls functions for many items. To be used as a context, which ends the workers.

    The work begins in this process. When that has taken as long as starting workers would, the
    rest goes to `workers` processes, one per usable core if not given. So nothing has to be known
    about the items beforehand, and it takes at worst twice the time of the better of these two
    ways. With the `scheduler` of a Dask cluster all of it runs there.

    Functions and items are pickled: functions of a module, `functools.partial` of them, paths.

    Raises
    ------
    InputError
        If no scheduler answers, Dask is not installed, or not this version of ps4rig on a worker.
    """

    def __init__(self, workers: int | None = None, scheduler: str | None = None) -> None:
        self._workers = workers or len(os.sched_getaffinity(0))
        self._spent_s = 0.0
        self._pool: Pool | None = None
        if scheduler is not None:
            from .dask_pool import DaskPool

            self._pool = DaskPool(scheduler)

    def map(self, function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """Yield ``function(item)`` for each item, in order.

        Items are taken as workers need them, so there may be any number.

        Raises
        ------
        InputError
            If an item's workers were killed again and again.
        """
        remaining = iter(items)
        for item in remaining:
            if self._pool is None and self._workers > 1 and self._spent_s >= STARTING_S:
                from .local_pool import LocalPool

                self._pool = LocalPool(self._workers)
            if self._pool is not None:
                yield from _in_order(self._pool, function, chain([item], remaining))
                return
            started_s = time.monotonic()
            result = function(item)
            self._spent_s += time.monotonic() - started_s
            yield result

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._pool is not None:
            if kind is None:
                self._pool.close()
            else:
                self._pool.abort()


@dataclass
class _Job(Generic[Item, Result]):
    item: Item
    future: Future[Result] | None = None
    deaths: int = 0

    def forget(self, died: tuple[type[Exception], ...]) -> None:
        """Ready to be submitted again, unless it has ended in a result or an error of its own."""
        future = self.future
        if future is not None and (not future.done() or isinstance(future.exception(), died)):
            self.future = None


def _in_order(
    pool: Pool, function: Callable[[Item], Result], items: Iterator[Item]
) -> Iterator[Result]:
    """Results in order. After a worker's death the items it may have had run one at a time.

    One death ends all futures, and none of them says whose it was. Items are begun in order, so
    those that were running are among the first unfinished, as many as there are workers. Alone,
    the item that kills its worker is found out, and no other is blamed for it.
    """
    jobs: deque[_Job[Item, Result]] = deque()
    suspects = 0
    while True:
        jobs.extend(_Job(item) for item in islice(items, pool.in_flight - len(jobs)))
        if not jobs:
            return
        first = jobs[0]
        try:
            for job in [first] if suspects else jobs:
                job.future = job.future or pool.submit(function, job.item)
            assert first.future is not None
            result = first.future.result()
        except CancelledError as error:  # by nobody here
            raise InputError(
                "the connection to the cluster broke; see that it runs, and start again"
            ) from error
        except pool.died as error:
            first.deaths += 1
            if first.deaths == pool.attempts:
                raise InputError(
                    f"{first.item}: the workers that had it were killed; it may need more memory "
                    "than there is, use fewer workers or leave it out"
                ) from error
            for job in jobs:
                job.forget(pool.died)
            pool.renew()
            suspects = pool.workers
        else:
            jobs.popleft()
            suspects = max(0, suspects - 1)
            yield result
