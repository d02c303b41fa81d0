"""`LiveStation`: state and trigger of a station for panel, API, PLC and MQTT."""

import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from capture.base.utc_time import utc_text
from capture.station.run.event_lines import json_fields
from capture.station.run.events import (
    Event,
    PartAnnounced,
    PartRecovered,
    RecipeLoaded,
    StationStopped,
)
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
from .live_view import LiveSnapshot, LiveView
from .subscription import LiveEvent
from .triggers import AttachedSource

_STARTING = "the station is starting"
# Loads that overlap: of one asker each, of which all but two are refused as busy.
_KEPT_LOADS = 8
# Refusals before the station takes triggers; a start takes seconds.
_KEPT_REFUSALS = 100


class LiveStation(LiveView):
    """A running station as its interfaces see it, in the process of the run."""

    def __init__(
        self,
        station: str,
        *,
        simulated: bool,
        trigger: str = "http",
        database: str = "results",
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._devices = DeviceStates(database)
        snapshot = LiveSnapshot(
            station, simulated, trigger, self._devices.all(), _STARTING, run=secrets.token_hex(4)
        )
        super().__init__(snapshot, now_s)
        self._target: TriggerTarget | None = None
        self._has_target = threading.Event()
        self._refused: list[tuple[Trigger, str]] = []
        self._refused_beyond = 0
        self._loaded: deque[RecipeLoaded] = deque(maxlen=_KEPT_LOADS)

    # What the run gives.

    def tell(self, event: Event) -> None:
        """Take an event of the station; the subscriber of its `Publisher`."""
        with self._lock:
            if isinstance(event, RecipeLoaded):
                if any(event is loaded for loaded in self._loaded):
                    return
                self._loaded.append(event)
            self._devices.take(event)
            self.announce(_fields(event))
            self._show_devices()

    def attached(self, source: TriggerSource | None) -> TriggerSource:
        """Return `source`, from whose run on `submit` reaches the station; None waits for it."""
        return AttachedSource(self.attach, source)

    def attach(self, target: TriggerTarget) -> None:
        """Pass triggers, and the refusals so far, to `target` from now on."""
        with self._lock:
            self._target = target
            if self._refused_beyond:
                reason = f"{self._refused_beyond} triggers more than could be recorded one by one"
                self._refused.append((Trigger(self._refused[-1][0].source), reason))
            for refused in self._refused:
                target.refuse(*refused)
            self._refused.clear()
            self._refused_beyond = 0
            self._has_target.set()

    # What interfaces do.

    def submit(self, trigger: Trigger) -> Answer:
        """Pass a trigger to the station. Never raises."""
        target = self._target
        return Refused(f"not ready: {_STARTING}") if target is None else target.submit(trigger)

    @property
    def is_attached(self) -> bool:
        """Whether the station takes triggers, and records those that it refuses."""
        return self._has_target.is_set()

    def refuse(self, trigger: Trigger, reason: str) -> None:
        """Record a trigger that an interface refused, at once or after `attach`. Never raises."""
        with self._lock:
            if self._target is not None:
                self._target.refuse(trigger, reason)
            elif len(self._refused) < _KEPT_REFUSALS:
                self._refused.append((trigger, reason))
            else:
                self._refused_beyond += 1

    def load_recipe(self, name: str, by: Asker) -> RecipeLoaded:
        """Let the station load a recipe; return when it judges all parts triggered from then on."""
        if self._target is None:
            raise RecipeRefused(f"not ready: {_STARTING}", RecipeRefusal.NOT_READY)
        loaded = self._target.load_recipe(name, by)
        self.tell(loaded)  # the publisher may come later
        return loaded

    def wait_until_ready(self, timeout_s: float) -> bool:
        """Wait until a trigger would be accepted; False after the time-out or a stop."""
        ends_s = self._now_s() + timeout_s
        if not self._has_target.wait(timeout_s):
            return False
        target = self._target
        return target is not None and target.wait_until_ready(max(ends_s - self._now_s(), 0.0))

    def set_device(self, device: Device) -> None:
        """Show the state of a device that the station does not know, such as the PLC."""
        with self._lock:
            self._devices.set(device)
            self._show_devices()

    def acknowledge(self, part_id: str, by: str) -> bool:
        """Record that somebody has seen a rejected part; False if it is not among the last."""
        with self._lock:
            rejected = {part.result.part_id: part for part in self._snapshot.rejected}
            if part_id not in rejected:
                return False
            if rejected[part_id].acknowledged_by is None:
                self.announce({"event": "acknowledged", "part_id": part_id, "by": by})
            target = self._target
        if target is not None:
            target.resume()
        return True

    def announce(self, fields: Mapping[str, Any]) -> None:
        """Tell all subscribers of something that an interface did, such as an override."""
        with self._lock:
            utc = utc_text(timespec="milliseconds")
            self.add(LiveEvent(self._snapshot.event_id + 1, utc, fields))

    def _show_devices(self) -> None:
        devices = self._devices.all()
        if devices != self._snapshot.devices:
            self.announce({"event": "devices", "devices": [vars(device) for device in devices]})


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
