"""Triggers by HTTP: a repeated request triggers no second part."""

import hashlib
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace

from capture.station.results.audit import ResultsAccess
from capture.station.run.triggers import Accepted, Refused, Trigger

from .security import Denied, Slots
from .station_link import StationLink

MAX_KEY_LENGTH = 200
# Number of keys in memory. A line triggers so many parts in a quarter of an hour, and a client
# repeats a request within seconds.
_MAX_KEYS = 1000
_DIGITS = 20
# Number of triggers that may wait for a database that does not answer. Each occupies one of the 40
# threads that serve requests.
MAX_WAITING = 8


@dataclass(frozen=True)
class _Repeated:
    """Answer to a trigger whose key was accepted before."""

    part_id: str
    number: int | None  # None while a part of an earlier run has no result


class KeyedTriggers:
    """Passes triggers to the station, each key once, also after a restart."""

    def __init__(self, live: StationLink, results: ResultsAccess) -> None:
        self._live, self._results = live, results
        self._lock = threading.Lock()
        self._slots = Slots(MAX_WAITING, "triggers wait for the station")
        # By the key: the answer, and the part id and the recipe that the client gave.
        self._accepted: OrderedDict[str, tuple[Accepted, str | None, str | None]] = OrderedDict()

    def submit(self, key: str | None, trigger: Trigger) -> Accepted | Refused | _Repeated:
        """Pass a trigger on; with a key that was accepted before, return its part."""
        with self._slots.slot():
            return self._submit(key, trigger)

    def _submit(self, key: str | None, trigger: Trigger) -> Accepted | Refused | _Repeated:
        part_id, recipe = trigger.part_id, trigger.recipe
        if key is None:
            return self._live.submit(trigger)
        # One at a time: of two requests with one key, the second waits for the first.
        with self._lock:
            if key in self._accepted:
                accepted, *first_request = self._accepted[key]
                _require_same(accepted.part_id, first_request, [part_id, recipe])
                return _Repeated(accepted.part_id, accepted.number)
            generated_id = f"key-{hashlib.sha256(key.encode()).hexdigest()[:_DIGITS]}"
            store = self._results.store
            if store.known_ids([generated_id]):
                entry = store.part(generated_id)
                recorded = None if entry is None else entry.result.recipe
                # The result of an interrupted part names no recipe.
                required = recorded if recipe and recorded else recipe
                _require_same(generated_id, [None, required], [part_id, recipe])
                return _Repeated(generated_id, None if entry is None else entry.result.number)
            answer = self._live.submit(replace(trigger, part_id=part_id or generated_id))
            # A refused trigger may be sent again with its key.
            if isinstance(answer, Accepted):
                self._accepted[key] = answer, part_id, recipe
                if len(self._accepted) > _MAX_KEYS:
                    self._accepted.popitem(last=False)
            return answer


def _require_same(
    accepted_id: str, first_request: list[str | None], request: list[str | None]
) -> None:
    """Refuse a key that comes with another part id or recipe than the first time."""
    if request != first_request:
        first, now = (
            f"part id {(part_id or 'none')[:100]!r} and recipe {recipe or 'none'}"
            for part_id, recipe in (first_request, request)
        )
        raise Denied(
            422,
            f"Idempotency-Key: was accepted for part {accepted_id} with {first}, and comes again "
            f"with {now}; give each part its own key",
        )
