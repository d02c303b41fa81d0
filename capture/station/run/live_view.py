"""`LiveView`: the state of a station and its latest events, in any process."""

import json
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from pydantic import TypeAdapter

from .events import Event, JsonEvent, PartAnnounced, PartRecovered, json_fields
from .station_state import StationState

# Number of events that are kept, five for each part: a browser that was disconnected for eighty
# parts misses none.
_KEPT_EVENTS = 400
# Largest number of events that wait for a subscriber, those of forty parts. A subscriber that is
# further behind reads the state again.
MAX_WAITING = 200
_RATE_WINDOW_S = 60.0
# Number of times that are kept for the rate: 10 parts a second in the window.
_KEPT_ANNOUNCEMENTS = 600
STATE = TypeAdapter(StationState)


@dataclass(frozen=True)
class LiveEvent:
    """An event with its position in the run and the state after it."""

    id: int  # position, from 1, without gaps
    utc: str
    event: Event
    state: StationState
    changed: frozenset[str] = frozenset()  # names of the fields of the state that it changed

    @cached_property
    def fields(self) -> Mapping[str, Any]:
        """The event for JSON; ``event`` names its kind."""
        fields = json_fields(self.event)
        if isinstance(self.event, PartAnnounced | PartRecovered):
            return {**self.event.result.row, **fields}
        return fields

    @cached_property
    def as_json(self) -> str:
        """The fields and ``utc`` as one line of JSON, made only once."""
        return json.dumps({"utc": self.utc, **self.fields}, allow_nan=False)

    @cached_property
    def as_line(self) -> bytes:
        """The line of the live socket: position, changed fields of the state, `as_json`."""
        changes = STATE.dump_json(self.state, include=set(self.changed), warnings=False)
        return b'{"id":%d,"state":%s,"event":%s}\n' % (self.id, changes, self.as_json.encode())

    @classmethod
    def of_line(cls, line: Mapping[str, Any], before: StationState) -> "LiveEvent":
        """Return the event of a line of the live socket; `before` is the state before it."""
        position, fields, changes = line["id"], line["event"], line["state"]
        state = STATE.validate_python({**vars(before), **changes, "event_id": position})
        return cls(position, fields.pop("utc"), JsonEvent(fields), state, frozenset(changes))


class Subscription:
    """Queue of events for a subscriber; all are dropped when more than `MAX_WAITING` wait.

    `wake` is called under a lock, and must not wait.
    """

    def __init__(self, wake: Callable[[], None] = lambda: None) -> None:
        self._wake = wake
        self._waiting: deque[LiveEvent] = deque()
        self._lost_count = 0
        self._is_closed = False
        self._lock = threading.Lock()

    @property
    def is_closed(self) -> bool:
        """Whether no further event comes."""
        return self._is_closed

    def put(self, event: LiveEvent) -> None:
        """Add an event; called by `LiveView`."""
        with self._lock:
            if len(self._waiting) >= MAX_WAITING:
                self._lost_count += len(self._waiting)
                self._waiting.clear()
            self._waiting.append(event)
            self._wake()

    def lose(self) -> None:
        """Drop the waiting events, and one that could not be added; called by `LiveView`."""
        with self._lock:
            self._lost_count += len(self._waiting) + 1
            self._waiting.clear()
            self._wake()

    def close(self) -> None:
        """Wake the subscriber for the last time."""
        with self._lock:
            self._is_closed = True
            self._wake()

    def take(self) -> tuple[list[LiveEvent], int]:
        """Return the waiting events, and the number of events that were lost before them."""
        with self._lock:
            events, lost_count = list(self._waiting), self._lost_count
            self._waiting.clear()
            self._lost_count = 0
            return events, lost_count


class LiveView:
    """The present state, the latest events and their subscriptions. Thread-safe."""

    def __init__(self, state: StationState, now_s: Callable[[], float] = time.monotonic) -> None:
        self._lock = threading.RLock()
        self._state, self._now_s = state, now_s
        self._announced_s: deque[float] = deque(maxlen=_KEPT_ANNOUNCEMENTS)
        self._events: deque[LiveEvent] = deque(maxlen=_KEPT_EVENTS)
        self._subscriptions: set[Subscription] = set()
        self._is_closed = False

    @property
    def state(self) -> StationState:
        """The state after the last event."""
        return self._state

    def begin(self, state: StationState) -> None:
        """Replace the state; events before it are dropped, and count as lost for subscribers."""
        with self._lock:
            self._state = state
            self._events.clear()
            for subscription in self._subscriptions:
                subscription.lose()

    def add(self, event: LiveEvent) -> None:
        """Add the next event."""
        with self._lock:
            self._state = event.state
            if "last" in event.changed:
                self._announced_s.append(self._now_s())
            self._events.append(event)
            for subscription in self._subscriptions:
                subscription.put(event)

    def close(self) -> None:
        """End all subscriptions; no event comes any more."""
        with self._lock:
            self._is_closed = True
            for subscription in self._subscriptions:
                subscription.close()

    def snapshot(self) -> StationState:
        """Return the state with its rates of this moment."""
        with self._lock:
            subscribers = len(self._subscriptions)
            return replace(self._state, parts_per_minute=self._rate(), subscribers=subscribers)

    def subscribe(self, wake: Callable[[], None] = lambda: None) -> Subscription:
        """Return a bounded queue of the events from now on."""
        with self._lock:
            subscription = Subscription(wake)
            if self._is_closed:
                subscription.close()
            self._subscriptions.add(subscription)
            return subscription

    def unsubscribe(self, subscription: Subscription) -> None:
        """End a subscription."""
        with self._lock:
            self._subscriptions.discard(subscription)
            subscription.close()

    def events_after(self, event_id: int) -> list[LiveEvent] | None:
        """Return the events after the one with this id; None if some of them were dropped."""
        with self._lock:
            last_id = self._state.event_id
            if not 0 <= event_id <= last_id:
                return None
            after = [event for event in self._events if event.id > event_id]
            return after if len(after) == last_id - event_id else None

    def _rate(self) -> float:
        now_s = self._now_s()
        recent = [at_s for at_s in self._announced_s if now_s - at_s <= _RATE_WINDOW_S]
        if len(recent) < 2:
            return 0.0
        return round(60.0 * (len(recent) - 1) / max(now_s - recent[0], 1e-3), 1)
