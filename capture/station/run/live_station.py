"""`LiveStation`: state and trigger of a station for panel, API, PLC and MQTT."""

import secrets
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from capture.base.utc_time import utc_text
from capture.station.domain.verdict import Decision
from capture.station.results.part_result import PartResult
from capture.station.run.event_lines import json_fields
from capture.station.run.events import (
    Event,
    PartAnnounced,
    PartBegun,
    PartRecovered,
    RecipeLoaded,
    SelfTestFinished,
    StateChanged,
    StationStopped,
    TriggerRefused,
)
from capture.station.run.states import Change, State
from capture.station.run.triggers import (
    Answer,
    Asker,
    RecipeRefusal,
    RecipeRefused,
    Refused,
    Trigger,
    TriggerSource,
    TriggerTarget,
)

from .devices import Device, DeviceStates
from .subscription import LiveEvent, Subscription
from .triggers import AttachedSource

# A part has four events: a browser that was disconnected for a hundred parts misses none.
_KEPT_EVENTS = 400
# The strip of the operator's page.
_KEPT_REJECTED = 12
_RATE_WINDOW_S = 60.0
# A line of 10 parts a second fills it in the window; the rate is right with fewer, too.
_KEPT_TIMES = 600
# Longest wait for the event of a loaded recipe, which passes other subscribers first.
_TOLD_S = 30.0


@dataclass(frozen=True)
class RejectedPart:
    """A part that did not pass, and who acknowledged it; None if nobody did."""

    result: PartResult
    acknowledged_by: str | None = None


@dataclass(frozen=True)
class LiveSnapshot:
    """What a station shows at one moment."""

    station: str
    run: str  # a random name of this run
    event_id: int  # of the last event in the snapshot
    state: State
    reason: str
    simulated: bool
    trigger: str
    recipe: RecipeLoaded | None  # None before it is loaded
    inspected: str | None  # the latest part, until its result is announced
    last: PartResult | None
    latency_ms: float | None  # from exposure to announcement; None before the first
    total_latency_ms: float  # sum over all parts of this run
    announced: Mapping[Decision, int]
    refused: int
    parts_per_minute: float  # over the last minute
    devices: tuple[Device, ...]
    rejected: tuple[RejectedPart, ...]  # the last parts that did not pass, the newest first
    subscribers: int  # browsers and programs that follow the events

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


class LiveStation:
    """A running station as its interfaces see it; any thread may call its methods.

    Its subscribers never delay the station: each has a bounded queue.
    """

    def __init__(
        self,
        station: str,
        *,
        simulated: bool,
        trigger: str = "http",
        database: str = "results",
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._station, self._simulated, self._trigger = station, simulated, trigger
        self._now_s = now_s
        self._lock = threading.Condition()  # notified of another recipe
        self._target: TriggerTarget | None = None
        self._has_target = threading.Event()
        self._state, self._reason = State.PREOPERATIONAL, "the station is starting"
        self._recipe: RecipeLoaded | None = None
        self._last: PartResult | None = None
        self._latency_ms: float | None = None
        self._total_latency_ms = 0.0
        self._announced: Counter[Decision] = Counter()
        self._refused = 0
        self._inspected: str | None = None
        self._announced_s: deque[float] = deque(maxlen=_KEPT_TIMES)
        self._devices = DeviceStates(database)
        self._rejected: deque[RejectedPart] = deque(maxlen=_KEPT_REJECTED)
        self._events: deque[LiveEvent] = deque(maxlen=_KEPT_EVENTS)
        self._event_id = 0
        self._subscriptions: set[Subscription] = set()
        self._is_closed = False
        self.run = secrets.token_hex(4)

    # What the run gives.

    def tell(self, event: Event) -> None:
        """Take an event of the station; the subscriber of its `Publisher`."""
        with self._lock:
            self._devices.take(event)
            match event:
                case RecipeLoaded():
                    self._recipe = event
                    self._lock.notify_all()
                case StateChanged(state, reason):
                    self._state, self._reason = state, reason
                case TriggerRefused():
                    self._refused += 1
                case PartBegun(part_id, _):
                    self._inspected = part_id
                case PartAnnounced(result, latency_ms):
                    if self._inspected == result.part_id:
                        self._inspected = None
                    self._last, self._latency_ms = result, latency_ms
                    self._total_latency_ms += latency_ms
                    self._announced[result.verdict.decision] += 1
                    self._announced_s.append(self._now_s())
                    if result.verdict.decision is not Decision.PASS:
                        self._rejected.appendleft(RejectedPart(result))
                case _:
                    pass
            self._append(_fields(event))
            if isinstance(event, SelfTestFinished | StateChanged) and not _is_of_a_part(event):
                self._append(self._devices_fields())

    def attached(self, source: TriggerSource | None) -> TriggerSource:
        """Return `source`, from whose run on `submit` reaches the station; None waits for it."""
        return AttachedSource(self.attach, source)

    def attach(self, target: TriggerTarget) -> None:
        """Pass triggers to `target` from now on."""
        with self._lock:
            self._target = target
            self._has_target.set()

    def close(self) -> None:
        """End all subscriptions; no event comes any more."""
        with self._lock:
            self._is_closed = True
            for subscription in self._subscriptions:
                subscription.close()

    # What interfaces do.

    def submit(self, trigger: Trigger) -> Answer:
        """Pass a trigger to the station. Never raises."""
        with self._lock:
            target = self._target
        if target is None:
            return Refused("not ready: the station is starting")
        return target.submit(trigger)

    @property
    def is_attached(self) -> bool:
        """Whether the station takes triggers, and records those that it refuses."""
        return self._has_target.is_set()

    def refuse(self, trigger: Trigger, reason: str) -> None:
        """Record a trigger that an interface refused; one before `attach` is lost. Never raises."""
        with self._lock:
            target = self._target
        if target is not None:
            target.refuse(trigger, reason)

    def load_recipe(self, name: str, by: Asker) -> RecipeLoaded:
        """Let the station load a recipe; return when it judges all parts triggered from then on."""
        with self._lock:
            target = self._target
        if target is None:
            raise RecipeRefused("not ready: the station is starting", RecipeRefusal.NOT_READY)
        loaded = target.load_recipe(name, by)
        with self._lock:
            # A snapshot must show the recipe, unless somebody has loaded another one since.
            self._lock.wait_for(lambda: self._recipe == loaded, _TOLD_S)
        return loaded

    def wait_until_ready(self, timeout_s: float) -> bool:
        """Wait until a trigger would be accepted; False after the time-out or a stop."""
        ends_s = self._now_s() + timeout_s
        if not self._has_target.wait(timeout_s):
            return False
        with self._lock:
            target = self._target
        return target is not None and target.wait_until_ready(max(ends_s - self._now_s(), 0.0))

    def set_device(self, device: Device) -> None:
        """Show the state of a device that the station does not know, such as the PLC."""
        with self._lock:
            if self._devices.set(device):
                self._append(self._devices_fields())

    def acknowledge(self, part_id: str, by: str) -> bool:
        """Record that somebody has seen a rejected part; False if it is not among the last."""
        with self._lock:
            rejected = [part for part in self._rejected if part.result.part_id == part_id]
            if not rejected:
                return False
            if rejected[0].acknowledged_by is None:
                position = self._rejected.index(rejected[0])
                self._rejected[position] = RejectedPart(rejected[0].result, by)
                self._append({"event": "acknowledged", "part_id": part_id, "by": by})
            return True

    def announce(self, fields: Mapping[str, Any]) -> None:
        """Tell all subscribers of something that an interface did, such as an override."""
        with self._lock:
            self._append(fields)

    def snapshot(self) -> LiveSnapshot:
        """Return what the station shows now."""
        with self._lock:
            return LiveSnapshot(
                station=self._station,
                run=self.run,
                event_id=self._event_id,
                state=self._state,
                reason=self._reason,
                simulated=self._simulated,
                trigger=self._trigger,
                recipe=self._recipe,
                inspected=self._inspected,
                last=self._last,
                latency_ms=self._latency_ms,
                total_latency_ms=self._total_latency_ms,
                announced=dict(self._announced),
                refused=self._refused,
                parts_per_minute=self._rate(),
                devices=self._devices.all(),
                rejected=tuple(self._rejected),
                subscribers=len(self._subscriptions),
            )

    def subscribe(
        self, wake: Callable[[], None] | None = None, most: int | None = None
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
            if not 0 <= event_id <= self._event_id:
                return None
            after = [event for event in self._events if event.id > event_id]
            return after if len(after) == self._event_id - event_id else None

    # These methods are called under the lock.

    def _append(self, fields: Mapping[str, Any]) -> None:
        self._event_id += 1
        event = LiveEvent(self._event_id, utc_text(timespec="milliseconds"), fields)
        self._events.append(event)
        for subscription in self._subscriptions:
            subscription.put(event)

    def _devices_fields(self) -> dict[str, Any]:
        return {"event": "devices", "devices": [vars(device) for device in self._devices.all()]}

    def _rate(self) -> float:
        now_s = self._now_s()
        recent = [
            instant_s for instant_s in self._announced_s if now_s - instant_s <= _RATE_WINDOW_S
        ]
        if len(recent) < 2:
            return 0.0
        return round(60.0 * (len(recent) - 1) / max(now_s - recent[0], 1e-3), 1)


def _is_of_a_part(event: StateChanged | SelfTestFinished) -> bool:
    return isinstance(event, StateChanged) and (
        event.state is State.EXECUTING or event.reason == Change.FREE
    )


def _fields(event: Event) -> dict[str, Any]:
    fields = json_fields(event)
    match event:
        case PartAnnounced(result, _) | PartRecovered(result):
            return {**result.row, **fields}
        case StationStopped():
            return fields | {
                "parts": {decision.value: n for decision, n in event.announced.items()}
            }
        case _:
            return fields
