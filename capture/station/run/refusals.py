"""`Refusals`: record refused triggers in the results, in the background."""

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from capture.base.utc_time import utc_text
from capture.station.results.database import ResultsUnavailable
from capture.station.results.part_result import shown_part_id
from capture.station.results.schema import refused_triggers
from capture.station.results.store import ResultStore

from .events import TriggerRefused
from .triggers import Trigger

# Largest number of waiting refusals; exceeded only if the database does not answer, or by a faulty
# client.
MAX_WAITING = 100
# Largest rate, so that a client in a loop does not fill the database: 8 of them made 425 rows a
# second.
_ROWS_PER_S = 20.0
# Pause between two attempts to write to a database that does not answer.
_RETRY_S = 0.5
_TimedRefusal = tuple[str, TriggerRefused]  # with the time of the trigger, UTC


class Refusals:
    """Records refused triggers from its own thread, so that `add` never waits.

    Those beyond `MAX_WAITING` are recorded as a count in one row.
    """

    def __init__(
        self,
        publish: Callable[[TriggerRefused], None],
        wait_for_room: Callable[[Callable[[], bool]], None],
    ) -> None:
        self._publish, self._wait_for_room = publish, wait_for_room
        self._changed = threading.Condition()
        self._waiting: deque[_TimedRefusal] = deque()
        self._last: _TimedRefusal
        self._overflow = 0  # triggers beyond those that wait
        self._closed = threading.Event()

    @contextmanager
    def recording(self, store: ResultStore, is_simulated: Callable[[], bool]) -> Iterator[None]:
        """Record during the block; a refusal that cannot be written is published as unrecorded."""
        thread = threading.Thread(
            target=self._run, args=(store, is_simulated), name="station refusals"
        )
        thread.start()
        try:
            yield
        finally:
            self._closed.set()
            with self._changed:
                self._changed.notify_all()
            thread.join()

    def add(self, trigger: Trigger, reason: str) -> None:
        """Add a refused trigger; after the end it is published as not recorded."""
        part_id = None if trigger.part_id is None else shown_part_id(trigger.part_id)
        refusal = TriggerRefused(trigger.source, part_id, reason, recorded=False)
        with self._changed:
            if self._closed.is_set():
                self._publish(refusal)
                return
            self._last = utc_text(timespec="milliseconds"), refusal
            if len(self._waiting) < MAX_WAITING:
                self._waiting.append(self._last)
            else:
                self._overflow += 1
            self._changed.notify_all()

    def _run(self, store: ResultStore, is_simulated: Callable[[], bool]) -> None:
        is_last = False  # after the end, all that wait are written in one last attempt
        while not is_last:
            with self._changed:
                self._changed.wait_for(
                    lambda: self._waiting or self._overflow or self._closed.is_set()
                )
                is_last = self._closed.is_set()
                refusals, overflow = self._next_refusals()
            is_recorded = _record(store, refusals, is_simulated=is_simulated())
            if not is_recorded:
                is_last = self._closed.wait(_RETRY_S)
                if not is_last:
                    continue
                with self._changed:
                    refusals, overflow = self._next_refusals()
            with self._changed:
                for _ in range(len(refusals) - bool(overflow)):
                    self._waiting.popleft()
                self._overflow -= overflow
            self._wait_for_room(self._closed.is_set)
            for _, refusal in refusals:
                self._publish(replace(refusal, recorded=is_recorded))
            self._closed.wait(len(refusals) / _ROWS_PER_S)

    def _next_refusals(self) -> tuple[list[_TimedRefusal], int]:
        """Return the refusals that wait, then one for the overflow; and the size of the latter."""
        refusals, overflow = list(self._waiting), self._overflow
        if overflow:
            utc, last = self._last
            reason = f"{overflow} triggers more than could be recorded one by one"
            refusals.append((utc, replace(last, part_id=None, reason=reason, triggers=overflow)))
        return refusals, overflow


def _record(store: ResultStore, refusals: list[_TimedRefusal], *, is_simulated: bool) -> bool:
    """Append the rows of refusals; False if the database does not answer."""
    rows = [
        {
            "utc": utc,
            "trigger": refusal.trigger,
            "part_id": refusal.part_id,
            "reason": refusal.reason,
            "simulated": is_simulated,
        }
        for utc, refusal in refusals
    ]
    try:
        if rows:
            store.append(refused_triggers, *rows)
    except ResultsUnavailable:
        return False
    return True
