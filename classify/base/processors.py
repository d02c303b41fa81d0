"""The processors that this process may use."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress


def usable_processors() -> list[int]:
    """Numbers of the processors that this process may use; all where that is unknown."""
    if hasattr(os, "sched_getaffinity"):
        # Of the main thread: others may be bound to one processor.
        return sorted(os.sched_getaffinity(os.getpid()))
    return list(range(os.cpu_count() or 1))


@contextmanager
def bound_to(processor: int) -> Iterator[None]:
    """Let this thread, and threads it starts, run on one processor, where that is possible."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    try:
        with suppress(OSError):
            os.sched_setaffinity(0, {processor})
        yield
    finally:
        with suppress(OSError):
            os.sched_setaffinity(0, before)
