"""How workers call a function: each in one thread, one call at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeVar

__all__ = ["call_in_one_thread"]

_one_at_a_time = threading.Lock()

Item = TypeVar("Item")
Result = TypeVar("Result")


def call_in_one_thread(function: Callable[[Item], Result], item: Item) -> Result:
    """``function(item)`` as workers call it: there is a worker for each core already.

    A worker of a Dask cluster may have several threads. They take turns, because some of the
    layers that numba has for its threads may not be entered twice.
    """
    import cv2
    import numba

    with _one_at_a_time:
        numba.set_num_threads(1)
        cv2.setNumThreads(1)
        return function(item)
