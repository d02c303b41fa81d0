"""Run one function over many items: here, on all cores, or on a Dask cluster.

All three yield the same results: one for each item, in the order of the items. An exception of the
function is raised in place of the item's result. The items of a killed worker are run again.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass
from itertools import chain, islice
from typing import TYPE_CHECKING, Generic, Self, TypeVar

from classify.base.errors import InputError
from classify.base.threads import usable_processors

if TYPE_CHECKING:
    from .dask_pool import DaskPool
    from .local_pool import LocalPool

# Number of sets from which the workers start at once, while this process solves the first set. A
# set of 512 x 512 px takes 10 ms here and 7 ms in two workers, which need 1.1 s to start.
_MANY_SETS = 200
_ONE_SET_S = 1e-9  # less than any set takes: the pool gets all sets but the first

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


class Batch:
    """Call functions for many items. Use it as a context, which ends the workers."""

    # With a `scheduler`, all items go to its Dask cluster. Otherwise the work begins in this
    # process, and after `start_up_s` the remaining items go to worker processes. For many `sets`
    # the workers start at once, and get all items but the first. Functions and items are pickled.

    def __init__(
        self,
        workers: int | None = None,
        scheduler: str | None = None,
        *,
        sets: int = 0,
        start_up_s: float = 2.0,
    ) -> None:
        self._workers = workers or len(usable_processors())
        # Start-up time of workers on a laptop: numba, scipy and OpenCV. Starting them after this
        # much work in this process costs at most twice the better choice (the ski rental problem).
        self._start_up_s = start_up_s
        self._spent_s = 0.0
        self._pool: LocalPool | DaskPool | None = None
        if scheduler is not None:
            from .dask_pool import DaskPool

            self._pool, self._start_up_s = DaskPool(scheduler), 0.0
        elif self._workers > 1 and sets >= _MANY_SETS:
            from .local_pool import LocalPool, load_tasks

            self._pool, self._start_up_s = LocalPool(self._workers), _ONE_SET_S
            for _ in range(self._workers):
                self._pool.submit(load_tasks, None)

    def map(
        self,
        function: Callable[[_Item], _Result],
        items: Iterable[_Item],
        local_function: Callable[[_Item], _Result] | None = None,
    ) -> Iterator[_Result]:
        """Yield ``function(item)`` in order, reading `items` as workers need them."""
        # In this process, `local_function` is called instead, which can show progress.
        remaining = iter(items)
        for item in remaining:
            is_long = self._spent_s >= self._start_up_s
            if is_long and self._pool is None and self._workers > 1:
                from .local_pool import LocalPool

                self._pool = LocalPool(self._workers)
            if is_long and self._pool is not None:
                yield from _in_order(self._pool, function, chain([item], remaining))
                return
            started_s = time.monotonic()
            result = (local_function or function)(item)
            self._spent_s += time.monotonic() - started_s
            yield result

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._pool is not None and kind is None:
            self._pool.close()
        elif self._pool is not None:
            self._pool.abort()


@dataclass
class _Job(Generic[_Item, _Result]):
    item: _Item
    future: Future[_Result] | None = None
    deaths: int = 0


def _in_order(
    pool: LocalPool | DaskPool, function: Callable[[_Item], _Result], items: Iterator[_Item]
) -> Iterator[_Result]:
    """Yield the results in order; after a worker's death, run suspect items one at a time."""
    # The death of one worker ends all futures, and the item that killed it is unknown. Items start
    # in order, so the suspects are the first unfinished items, one for each worker. An item that
    # runs alone and kills its worker again is the cause.
    jobs: deque[_Job[_Item, _Result]] = deque()
    suspect_count = 0
    while True:
        jobs.extend(_Job(item) for item in islice(items, pool.in_flight - len(jobs)))
        if not jobs:
            return
        first = jobs[0]
        try:
            for job in [first] if suspect_count else jobs:
                job.future = job.future or pool.submit(function, job.item)
            assert first.future is not None
            result = first.future.result()
        except CancelledError as error:  # by Dask: this module cancels no future
            raise InputError(
                "the connection to the cluster broke; check the cluster and start again"
            ) from error
        except pool.death_types as error:
            first.deaths += 1
            if first.deaths == pool.attempts:
                raise InputError(
                    f"{first.item}: the workers that had it were killed; it may need more memory "
                    "than there is, so use fewer workers or leave it out"
                ) from error
            for job in jobs:  # those without a result are submitted again
                future = job.future
                if future is None:
                    continue
                if not future.done() or isinstance(future.exception(), pool.death_types):
                    job.future = None
            pool.renew()
            suspect_count = pool.workers
        else:
            jobs.popleft()
            suspect_count = max(0, suspect_count - 1)
            yield result
