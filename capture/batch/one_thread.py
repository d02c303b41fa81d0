"""Run the items of a batch in one thread."""

import threading
from collections.abc import Callable
from typing import TypeVar

_one_at_a_time = threading.Lock()

Item = TypeVar("Item")
Result = TypeVar("Result")


def call_in_one_thread(function: Callable[[Item], Result], item: Item) -> Result:
    """Return ``function(item)``, computed in one thread: each core has its own worker.

    The threads of a Dask worker take turns, because the settings below hold for the whole process.
    """
    import cv2

    from classify.threads import set_thread_count

    with _one_at_a_time:
        set_thread_count(1)
        cv2.setNumThreads(1)
        return function(item)
