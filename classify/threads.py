"""Share out work among threads that are kept from call to call."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import TypeVar

from .errors import InputError

Item = TypeVar("Item")
Result = TypeVar("Result")

# Pixels of one strip of rows: 200 us of work, which is long for the 10 us of a call and short
# enough that threads end at about the same time.
STRIP_PX = 1 << 17

_count: int | None = None


def thread_count() -> int:
    """Number of threads that kernels may use.

    That of `set_thread_count`, else of the environment variable ``NUMBA_NUM_THREADS``, else one
    for each processor that this process may run on.

    Raises
    ------
    InputError
        If ``NUMBA_NUM_THREADS`` is not a positive whole number.
    """
    if _count is not None:
        return _count
    text = os.environ.get("NUMBA_NUM_THREADS", "").strip()
    if not text:
        return usable_cores()
    if not text.isdecimal() or int(text) < 1:
        raise InputError(f"NUMBA_NUM_THREADS is {text!r}; give a whole number from 1, or unset it")
    return int(text)


def usable_cores() -> int:
    """Number of processors that this process may run on, or of all where that is not known."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def set_thread_count(count: int | None) -> None:
    """Use `count` threads from now on in this process; None returns to the default.

    Raises
    ------
    InputError
        If it is less than 1.
    """
    global _count
    if count is not None and count < 1:
        raise InputError(f"{count} threads; give 1 or more")
    _count = count


def map_in_threads(function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """``[function(item) for item in items]``, with the items shared out among the threads.

    The calling thread takes part, so that a call within a call cannot wait for itself.
    """
    results: dict[int, Result] = {}
    # One iterator for all threads: each takes the next item as soon as it is free.
    indices = iter(range(len(items)))

    def work() -> None:
        for index in indices:
            results[index] = function(items[index])

    helpers = min(thread_count(), len(items)) - 1
    futures = [_kept_threads(thread_count()).submit(work) for _ in range(helpers)]
    try:
        work()
    finally:
        # Threads that have not started by now have nothing left to do.
        started = [future for future in futures if not future.cancel()]
        errors = [future.exception() for future in started]
    for error in errors:
        if error is not None:
            raise error
    return [results[index] for index in range(len(items))]


def beside(work: Callable[[], Result]) -> Callable[[], Result]:
    """Start work in another thread; the function returned waits for its result and returns it.

    The caller does the work itself if no thread was free until then.
    """
    future = _kept_threads(thread_count()).submit(work) if thread_count() > 1 else None

    def result() -> Result:
        return work() if future is None or future.cancel() else future.result()

    return result


def run_on_rows(
    function: Callable[[int, int], None], shape: tuple[int, int], strip_px: int = STRIP_PX
) -> None:
    """Call ``function(first, last)`` for strips of rows that together are all of `shape`.

    The strips do not depend on the number of threads.
    """
    rows, columns = shape
    height = max(1, strip_px // max(columns, 1))
    strips = [(first, min(first + height, rows)) for first in range(0, rows, height)]
    map_in_threads(lambda strip: function(*strip), strips)


@lru_cache(maxsize=1)
def _kept_threads(count: int) -> ThreadPoolExecutor:
    """Threads that wait for work; to start new ones takes as long as to solve a small frame."""
    return ThreadPoolExecutor(count)


if hasattr(os, "register_at_fork"):
    # The threads of a process do not run in its forked children.
    os.register_at_fork(after_in_child=_kept_threads.cache_clear)
