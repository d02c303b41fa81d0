"""Waiting for what other threads and programs do."""

import time
from collections.abc import Callable
from typing import TypeVar

# Only tests that fail wait for so long.
_PATIENCE_S = 120.0

T = TypeVar("T")


def until_so(is_so: Callable[[], T]) -> T:
    """Wait until something is so, and return it."""
    ends_s = time.monotonic() + _PATIENCE_S
    while not (so := is_so()):
        assert time.monotonic() < ends_s, "it did not happen"
        time.sleep(0.01)
    return so
