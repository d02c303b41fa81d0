"""What happens at a station, as values that terminal, log, panel and PLC subscribe to."""

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass

from rig.doctor.check import Check

from .results.part_result import PartResult
from .states import State


@dataclass(frozen=True)
class StateChanged:
    """The station is in another state."""

    state: State
    reason: str


@dataclass(frozen=True)
class SelfTestFinished:
    """The self-test was made; a fault among its checks keeps the station from ready."""

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
    """No further exposure of the part is needed: it may move."""

    part_id: str
    number: int


@dataclass(frozen=True)
class PartAnnounced:
    """The result of a part; its set file and its row are on disk."""

    result: PartResult


@dataclass(frozen=True)
class PartRecovered:
    """A part that an earlier run began and did not end has its result, ERROR, now."""

    result: PartResult


@dataclass(frozen=True)
class Warned:
    """Something that a person should look at; parts are judged all the same."""

    text: str


@dataclass(frozen=True)
class StationStopped:
    """The run is over; `reason` says why."""

    reason: str
    announced: dict[str, int]
    refused: int


Event = (
    StateChanged
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
    """Passes events to all subscribers, one event at a time, in the order of `publish`.

    An error of a subscriber is logged and concerns neither the station nor other subscribers.
    """

    def __init__(self, *subscribers: Subscriber) -> None:
        self._subscribers = subscribers
        self._lock = threading.RLock()

    def publish(self, event: Event) -> None:
        """Pass an event to every subscriber."""
        with self._lock:
            for subscriber in self._subscribers:
                try:
                    subscriber(event)
                except Exception:
                    logging.getLogger(__name__).exception("a subscriber failed on %s", event)
