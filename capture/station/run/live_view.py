"""`LiveView`: what a station shows at a moment, and its latest events, in any process."""

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from capture.station.domain.verdict import Cause, Decision
from capture.station.results.part_result import PartResult, result_of
from capture.station.run.events import RecipeLoaded
from capture.station.run.states import State

from .devices import Device
from .subscription import LiveEvent, Subscription

# A part has four events: a browser that was disconnected for a hundred parts misses none.
_KEPT_EVENTS = 400
# The strip of the operator's page.
_KEPT_REJECTED = 12
_RATE_WINDOW_S = 60.0
# A line of 10 parts a second fills it in the window; the rate is right with fewer, too.
_KEPT_TIMES = 600
_COLUMNS = {column.name for column in fields(PartResult)} - {"verdict"} | {
    "decision", "reason", "causes",
}  # fmt: skip


@dataclass(frozen=True)
class RejectedPart:
    """A part that did not pass, and who acknowledged it; None if nobody did."""

    result: PartResult
    acknowledged_by: str | None = None


@dataclass(frozen=True)
class LiveSnapshot:
    """What a station shows at one moment."""

    station: str
    simulated: bool
    trigger: str
    devices: tuple[Device, ...]
    reason: str
    run: str = ""  # a random name of this run; empty where none is known
    event_id: int = 0  # of the last event in the snapshot
    state: State = State.PREOPERATIONAL
    recipe: RecipeLoaded | None = None  # None before it is loaded
    inspected: str | None = None  # the latest part, until its result is announced
    last: PartResult | None = None
    latency_ms: float | None = None  # from exposure to announcement; None before the first
    total_latency_ms: float = 0.0  # sum over all parts of this run
    announced: Mapping[Decision, int] = field(default_factory=dict)
    refused: int = 0
    parts_per_minute: float = 0.0  # over the last minute
    rejected: tuple[RejectedPart, ...] = ()  # that did not pass, the newest first
    subscribers: int = 0  # browsers and programs that follow the events

    def fields(self) -> dict[str, Any]:
        """Return the snapshot as fields of JSON."""
        last = None if self.last is None else {**self.last.row, "latency_ms": self.latency_ms}
        return dict(vars(self)) | {
            "recipe": None if self.recipe is None else vars(self.recipe),
            "last": last,
            "announced": {decision.value: self.announced.get(decision, 0) for decision in Decision},
            "devices": [vars(device) for device in self.devices],
            "rejected": [
                {**part.result.row, "acknowledged_by": part.acknowledged_by}
                for part in self.rejected
            ],
        }


def folded(before: LiveSnapshot, event: LiveEvent) -> LiveSnapshot:
    """Return the snapshot after an event."""
    return replace(before, event_id=event.id, **_changes(before, event.fields))


def _changes(before: LiveSnapshot, about: Mapping[str, Any]) -> dict[str, Any]:
    match about["event"]:
        case "recipe":
            named = {column.name: about[column.name] for column in fields(RecipeLoaded)}
            return {"recipe": RecipeLoaded(**named)}
        case "state":
            return {"state": State(about["state"]), "reason": about["reason"]}
        case "refused":
            return {"refused": before.refused + 1}
        case "begun":
            return {"inspected": about["part_id"]}
        case "devices":
            return {"devices": tuple(Device(**device) for device in about["devices"])}
        case "part":
            return _announced(before, about)
        case "acknowledged":
            return {
                "rejected": tuple(
                    replace(part, acknowledged_by=about["by"])
                    if part.result.part_id == about["part_id"]
                    else part
                    for part in before.rejected
                )
            }
        case _:
            return {}


def _announced(before: LiveSnapshot, about: Mapping[str, Any]) -> dict[str, Any]:
    result, latency_ms = result_of({name: about[name] for name in _COLUMNS}), about["latency_ms"]
    decision, rejected = result.verdict.decision, before.rejected
    if decision is not Decision.PASS and Cause.COLLECTED not in result.verdict.causes:
        rejected = (RejectedPart(result), *rejected)[:_KEPT_REJECTED]
    return {
        "inspected": None if before.inspected == result.part_id else before.inspected,
        "last": result,
        "latency_ms": latency_ms,
        "total_latency_ms": before.total_latency_ms + latency_ms,
        "announced": {**before.announced, decision: before.announced.get(decision, 0) + 1},
        "rejected": rejected,
    }


class LiveView:
    """The present snapshot, the latest events and who follows them; any thread may call it.

    Its subscribers never delay anybody: each has a bounded queue.
    """

    def __init__(self, snapshot: LiveSnapshot, now_s: Callable[[], float] = time.monotonic) -> None:
        self._lock = threading.RLock()
        self._snapshot, self._now_s = snapshot, now_s
        self._announced_s: deque[float] = deque(maxlen=_KEPT_TIMES)
        self._events: deque[LiveEvent] = deque(maxlen=_KEPT_EVENTS)
        self._subscriptions: set[Subscription] = set()
        self._is_closed = False

    @property
    def run(self) -> str:
        """The name of the run."""
        return self._snapshot.run

    def begin(self, snapshot: LiveSnapshot) -> None:
        """Show another state, without the events that led to it; subscribers have lost those."""
        with self._lock:
            self._snapshot = snapshot
            self._events.clear()
            for subscription in self._subscriptions:
                subscription.lose()

    def add(self, event: LiveEvent) -> None:
        """Take the next event."""
        with self._lock:
            self._snapshot = folded(self._snapshot, event)
            if event.fields["event"] == "part":
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

    def snapshot(self) -> LiveSnapshot:
        """Return what the station shows now."""
        with self._lock:
            subscribers = len(self._subscriptions)
            return replace(self._snapshot, parts_per_minute=self._rate(), subscribers=subscribers)

    def subscribe(
        self, wake: Callable[[], None] = lambda: None, most: int | None = None
    ) -> Subscription | None:
        """Return a bounded queue of the events from now on; None if there are `most` already."""
        with self._lock:
            if most is not None and len(self._subscriptions) >= most:
                return None
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
        """Return the events after one, or None if not all of them are kept any more."""
        with self._lock:
            last_id = self._snapshot.event_id
            if not 0 <= event_id <= last_id:
                return None
            after = [event for event in self._events if event.id > event_id]
            return after if len(after) == last_id - event_id else None

    def _rate(self) -> float:
        now_s = self._now_s()
        recent = [
            instant_s for instant_s in self._announced_s if now_s - instant_s <= _RATE_WINDOW_S
        ]
        if len(recent) < 2:
            return 0.0
        return round(60.0 * (len(recent) - 1) / max(now_s - recent[0], 1e-3), 1)
