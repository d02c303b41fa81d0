"""Waiting for what other threads and programs do."""

import threading
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


class Gate:
    """Holds up a thread until a test opens it."""

    def __init__(self) -> None:
        self._reached, self._opened = threading.Event(), threading.Event()

    def hold(self, *_: object) -> None:
        """Wait until the gate is open."""
        self._reached.set()
        assert self._opened.wait(_PATIENCE_S), "nobody opened it"

    @property
    def is_reached(self) -> bool:
        """Whether a thread was held up."""
        return self._reached.is_set()

    def until_reached(self) -> None:
        """Wait until a thread is held up."""
        assert self._reached.wait(_PATIENCE_S), "nobody came"

    def open(self) -> None:
        """Let all threads pass, from now on."""
        self._opened.set()
