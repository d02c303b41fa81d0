"""`Subscription`: a bounded queue of events that never delays the station."""

import json
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

# Some fifty parts; a subscriber that is further behind reads the state anew.
MOST_WAITING = 200


@dataclass(frozen=True)
class LiveEvent:
    """Something that happened, with its position in the run."""

    id: int  # position, from 1, without gaps
    utc: str
    fields: Mapping[str, Any]  # for JSON; ``event`` names its kind

    @cached_property
    def as_json(self) -> str:
        """The fields and ``utc`` as one line of JSON, made once for all who want it."""
        return json.dumps({"utc": self.utc, **self.fields}, allow_nan=False)

    @property
    def as_line(self) -> bytes:
        """The line of the live socket: its position, and `as_json`."""
        return f'{{"id": {self.id}, {self.as_json[1:]}\n'.encode()


class Subscription:
    """The events that a subscriber has not taken yet; all are lost when `MOST_WAITING` wait.

    `wake` is called under a lock from a thread of the station, and must not wait.
    """

    def __init__(self, wake: Callable[[], None] = lambda: None) -> None:
        self._wake = wake
        self._waiting: deque[LiveEvent] = deque()
        self._missed = 0
        self._is_closed = False
        self._lock = threading.Lock()

    @property
    def is_closed(self) -> bool:
        """Whether no further event comes."""
        return self._is_closed

    def put(self, event: LiveEvent) -> None:
        """Add an event; called by `LiveView`."""
        with self._lock:
            if len(self._waiting) >= MOST_WAITING:
                self._missed += len(self._waiting)
                self._waiting.clear()
            self._waiting.append(event)
            self._wake()

    def lose(self) -> None:
        """Drop what waits and what nobody could add; called by `LiveView`."""
        with self._lock:
            self._missed += len(self._waiting) + 1
            self._waiting.clear()
            self._wake()

    def close(self) -> None:
        """Wake the subscriber for the last time."""
        with self._lock:
            self._is_closed = True
            self._wake()

    def take(self) -> tuple[list[LiveEvent], int]:
        """Return all events that wait, and how many were lost before them."""
        with self._lock:
            events, missed = list(self._waiting), self._missed
            self._waiting.clear()
            self._missed = 0
            return events, missed
