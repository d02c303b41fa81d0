"""Whether something that works for months keeps memory for each piece of its work."""

import tracemalloc
from collections.abc import Callable

import pytest

from capture.base.process_settings import resident_bytes


def growth_bytes(work: Callable[[int, int], object], first: int, full: int, last: int) -> int:
    """Memory that work on the numbers `full` to `last` adds to that of `first` to `full`."""
    tracemalloc.start()
    try:
        work(first, full)
        before_bytes, _ = tracemalloc.get_traced_memory()
        work(full, last)
        after_bytes, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return after_bytes - before_bytes


def resident_mb() -> float:
    """Resident memory of this process."""
    resident = resident_bytes()
    if resident is None:
        pytest.skip("memory is read from /proc")
    return resident / 1e6
