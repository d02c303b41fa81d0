"""Triggers by HTTP: a repeated request triggers no second part."""

import hashlib
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace

from capture.station.results.audit import ResultsAccess
from capture.station.run.live_station import LiveStation
from capture.station.run.triggers import Accepted, Refused, Trigger
from classify.base.errors import Ps4rigError

from .security import Slots
from .station_link import StationLink

LONGEST_KEY = 200
# A client repeats a request within seconds; a line makes a thousand parts in a quarter of an hour.
_KEPT_KEYS = 1000
_DIGITS = 20
# Each may wait for a database that does not answer, in one of the 40 threads that serve requests.
MOST_WAITING = 8


@dataclass(frozen=True)
class Repeated:
    """The trigger of this key was accepted before."""

    part_id: str
    number: int | None  # None while a part of an earlier run has no result


class OtherPart(Ps4rigError):  # noqa: N818 - what a client asked, no error of the program
    """A key that was accepted for one part comes with another part or recipe."""


class KeyedTriggers:
    """Passes triggers to the station, each key once, also after a restart.

    A key without a part id determines the id of the part.
    """

    def __init__(self, live: LiveStation | StationLink, results: ResultsAccess) -> None:
        self._live, self._results = live, results
        self._lock = threading.Lock()
        self._slots = Slots(MOST_WAITING, "triggers wait for the station")
        # By the key: the answer, and the part id and the recipe that the client gave.
        self._accepted: OrderedDict[str, tuple[Accepted, str | None, str | None]] = OrderedDict()

    def submit(self, key: str | None, trigger: Trigger) -> Accepted | Refused | Repeated:
        """Pass a trigger on; with a key that was accepted before, return its part."""
        with self._slots.taken():
            return self._submit(key, trigger)

    def _submit(self, key: str | None, trigger: Trigger) -> Accepted | Refused | Repeated:
        part_id, recipe = trigger.part_id, trigger.recipe
        if key is None:
            return self._live.submit(trigger)
        # One at a time: of two requests with one key, the second waits for the first.
        with self._lock:
            if key in self._accepted:
                known, given, required = self._accepted[key]
                _require_same(given, part_id, known.part_id)
                _require_recipe(required, recipe, known.part_id)
                return Repeated(known.part_id, known.number)
            made = f"key-{hashlib.sha256(key.encode()).hexdigest()[:_DIGITS]}"
            store = self._results.store
            if store.known([made]):
                _require_same(None, part_id, made)
                entry = store.part(made)
                recorded = None if entry is None else entry.result.recipe
                # The result of an interrupted part names no recipe.
                if recipe is not None and recorded is not None:
                    _require_recipe(recorded, recipe, made)
                return Repeated(made, None if entry is None else entry.result.number)
            answer = self._live.submit(replace(trigger, part_id=part_id or made))
            # A refused trigger may be sent again with its key.
            if isinstance(answer, Accepted):
                self._accepted[key] = answer, part_id, recipe
                if len(self._accepted) > _KEPT_KEYS:
                    self._accepted.popitem(last=False)
            return answer


def _require_same(given: str | None, part_id: str | None, known: str) -> None:
    if part_id != given:
        words = "without a part id" if part_id is None else f"for part {part_id[:100]!r}"
        raise OtherPart(
            f"Idempotency-Key: was accepted for part {known} and comes again {words}; give each "
            "part its own key"
        )


def _require_recipe(given: str | None, recipe: str | None, known: str) -> None:
    if recipe != given:
        raise OtherPart(
            f"Idempotency-Key: was accepted for part {known} and {_named(given)}, and comes again "
            f"with {_named(recipe)}; give each part its own key"
        )


def _named(recipe: str | None) -> str:
    return "no recipe" if recipe is None else f"recipe {recipe}"
