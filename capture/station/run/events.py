"""Events of a station, to which terminal, log, panel and PLC subscribe."""

import logging
import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Self

from capture.station.domain.verdict import Decision
from capture.station.results.part_result import PartResult
from rig.doctor.check import Check

from .states import State

_log = logging.getLogger(__name__)
# Events of some hundred parts; a subscriber that is further behind hangs.
MOST_EVENTS = 1000
_POLL_S = 0.02


@dataclass(frozen=True)
class RecipeLoaded:
    """A recipe was loaded; it judges all parts that are triggered from now on."""

    name: str
    version: int
    sha256: str
    by: str = ""  # who asked for it; empty at the start


@dataclass(frozen=True)
class StateChanged:
    """The station is in another state."""

    state: State
    reason: str


@dataclass(frozen=True)
class SelfTestFinished:
    """The self-test has run; with a fault among its checks the station does not become ready."""

    checks: tuple[Check, ...]


@dataclass(frozen=True)
class TriggerRefused:
    """A trigger could not be served; `recorded` says whether the refusal is in the results."""

    source: str
    part_id: str | None
    reason: str
    recorded: bool


@dataclass(frozen=True)
class PartBegun:
    """A trigger was accepted, and the part has its row in the results."""

    part_id: str
    number: int


@dataclass(frozen=True)
class ExposureComplete:
    """No further exposure of the part is needed: it may move. Published after the last attempt."""

    part_id: str
    number: int


@dataclass(frozen=True)
class PartAnnounced:
    """The result of a part; its set file and its row are on disk."""

    result: PartResult
    latency_ms: float  # since the end of its last exposure


@dataclass(frozen=True)
class PartRecovered:
    """A part that an earlier run began and did not finish got the verdict ERROR."""

    result: PartResult


@dataclass(frozen=True)
class Warned:
    """A warning for people; the station goes on."""

    text: str


@dataclass(frozen=True)
class StationStopped:
    """The run is over."""

    reason: str
    announced: Mapping[Decision, int]
    refused: int  # triggers that were not served

    @property
    def rejected(self) -> int:
        """Number of parts that did not pass."""
        return sum(count for verdict, count in self.announced.items() if verdict != Decision.PASS)


Event = (
    RecipeLoaded
    | StateChanged
    | SelfTestFinished
    | TriggerRefused
    | PartBegun
    | ExposureComplete
    | PartAnnounced
    | PartRecovered
    | Warned
    | StationStopped
)
Subscriber = Callable[[Event], None]


class Publisher:
    """Passes events to all subscribers, in order, from a thread of its own.

    `publish` never waits and may be called under a lock; `wait_for_room` bounds the memory.
    """

    def __init__(self, *subscribers: Subscriber) -> None:
        self._subscribers = subscribers
        self._events: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="station events")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._events.put(None)
        self._thread.join()

    def publish(self, event: Event) -> None:
        """Pass an event on to every subscriber."""
        self._events.put(event)

    def wait_for_room(self, is_over: Callable[[], bool]) -> None:
        """Wait while subscribers are `MOST_EVENTS` behind, unless `is_over`.

        A call by a subscriber returns at once.
        """
        while self._events.qsize() >= MOST_EVENTS and not is_over():
            if threading.current_thread() is self._thread:
                return
            time.sleep(_POLL_S)

    def _run(self) -> None:
        while (event := self._events.get()) is not None:
            for subscriber in self._subscribers:
                try:
                    subscriber(event)
                except Exception:
                    _log.exception("a subscriber failed on %s", type(event).__name__)
