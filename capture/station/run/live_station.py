"""`LiveStation`: the state of a run, its events for all interfaces, and their requests to it."""

import logging
import queue
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

from capture.base.utc_time import utc_text
from capture.station.domain.fault import Fault

from .events import (
    TRANSITIONS,
    Change,
    Device,
    DevicesChanged,
    Event,
    PartAcknowledged,
    RecipeLoaded,
    State,
    StateChanged,
)
from .live_view import LiveEvent, LiveView
from .refusals import Refusals
from .station_state import STARTING, StationState, changes_by
from .triggers import Answer, Asker, RecipeRefusal, RecipeRefused, Refused, Trigger

if TYPE_CHECKING:
    from .cycle import Station

Subscriber = Callable[[LiveEvent], None]
# Largest number of events that wait for delivery, those of two hundred parts; a subscriber that is
# further behind counts as hung.
MAX_EVENTS = 1000
_POLL_S = 0.02
_log = logging.getLogger(__name__)


class LiveStation(LiveView):
    """Owner of a run's state; passes events to its subscribers, and requests to its cycle.

    `publish` never waits; publishers call `wait_for_room` first, to bound the events in memory.
    """

    def __init__(
        self,
        station: str,
        *,
        simulated: bool,
        trigger: str = "http",
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        state = StationState(station, simulated, trigger, run=secrets.token_hex(4))
        super().__init__(state, now_s)
        self._queue: queue.SimpleQueue[LiveEvent | None] = queue.SimpleQueue()
        self._subscribers: tuple[Subscriber, ...] = ()
        self._thread = threading.Thread(target=self._deliver, name="station events")
        self._changed = threading.Condition(self._lock)
        self.refusals = Refusals(self.publish, self.wait_for_room)
        self._target: Station | None = None

    # The run.

    def publish(self, event: Event) -> None:
        """Change the state by an event, and deliver both to all subscribers."""
        with self._lock:
            before, changes = self._state, changes_by(event, self._state)
            state = replace(before, event_id=before.event_id + 1, **changes)
            utc = utc_text(timespec="milliseconds")
            published = LiveEvent(state.event_id, utc, event, state, frozenset(changes))
            self.add(published)
            if self._subscribers:
                self._queue.put(published)
            if state.devices != before.devices:
                self.publish(DevicesChanged(state.devices))

    def change(self, change: Change, fault: Fault | None = None, why: str = "") -> None:
        """Make a transition of `TRANSITIONS`; ValueError if the table does not have it."""
        with self._changed:
            old = self._state.state
            if (old, change) not in TRANSITIONS:
                raise ValueError(f"a station that is {old} cannot change by: {change}")
            new = TRANSITIONS[old, change]
            if new is not old or fault != self._state.fault:
                self.publish(StateChanged(new, change, fault, why))
                self._changed.notify_all()

    def wait_for(self, state: State, timeout_s: float) -> bool:
        """Wait until the station is in a state; False after the time-out."""
        with self._changed:
            return self._changed.wait_for(lambda: self._state.state is state, timeout_s)

    @contextmanager
    def telling(self, *subscribers: Subscriber) -> Iterator[None]:
        """Deliver all events during the block to subscribers, in order, in a thread of its own."""
        self._subscribers = subscribers
        self._thread.start()
        try:
            yield
        finally:
            self._queue.put(None)
            self._thread.join()

    def wait_for_room(self, is_over: Callable[[], bool]) -> None:
        """Wait until subscribers are less than `MAX_EVENTS` behind, or `is_over`.

        A call by a subscriber returns at once.
        """
        while self._queue.qsize() >= MAX_EVENTS and not is_over():
            if threading.current_thread() is self._thread:
                return
            time.sleep(_POLL_S)

    def _deliver(self) -> None:
        is_last = False
        while not (is_last and self._queue.empty()):  # a subscriber may publish, too
            published = self._queue.get()
            if published is None:
                is_last = True
                continue
            for subscriber in self._subscribers:
                try:
                    subscriber(published)
                except Exception:
                    _log.exception("a subscriber failed on %s", type(published.event).__name__)

    def attach(self, target: "Station") -> None:
        """Pass triggers and requests to `target` from now on."""
        self._target = target

    # For interfaces.

    def submit(self, trigger: Trigger) -> Answer:
        """Pass a trigger to the station. Never raises."""
        if self._target is not None:
            return self._target.submit(trigger)
        refused = Refused(f"not ready: {STARTING}")
        self.refusals.add(trigger, refused.reason)
        return refused

    def load_recipe(self, name: str, by: Asker) -> RecipeLoaded:
        """Let the station load a recipe; return when it judges all parts triggered from then on."""
        if self._target is None:
            raise RecipeRefused(f"not ready: {STARTING}", RecipeRefusal.NOT_READY)
        return self._target.load_recipe(name, by)

    def show_device(self, device: Device) -> None:
        """Show the state of a device that the self-test does not test, such as the PLC."""
        with self._lock:
            if device not in self._state.tested:
                self.publish(device)

    def acknowledge(self, part_id: str | None, by: str) -> bool:
        """Record that somebody has seen a rejected part, or for None the fault that stops the line.

        Returns False if there is no such part or fault.
        """
        with self._lock:
            rejected = {part.result.part_id: part for part in self._state.rejected}
            if part_id is None:
                if not self._state.is_stopped_by_errors:
                    return False
            elif part_id not in rejected:
                return False
            elif rejected[part_id].acknowledged_by is None:
                self.publish(PartAcknowledged(part_id, by))
        if self._target is not None:
            self._target.resume()
        return True
