"""`Refusals`: refused triggers on their way into the results."""

import threading
from collections import deque
from typing import Self

from capture.station.results.database import ResultsUnavailable
from capture.station.results.part_id import shown_part_id
from capture.station.results.store import RefusedTrigger, ResultStore

from .events import Publisher, TriggerRefused

# More than this wait only if the database does not answer, or a client is out of order.
MOST_WAITING = 100
# A client in a loop may not fill the database: 8 of them made 425 rows a second.
_ROWS_PER_S = 20.0
# Pause between two attempts to write to a database that does not answer.
_RETRY_S = 0.5


class Refusals:
    """Records refused triggers from a thread of its own; `add` never waits.

    At most `MOST_WAITING` wait; one row counts those beyond. What the database does not take at the
    end of the ``with`` block is published as not recorded.
    """

    def __init__(self, store: ResultStore, publisher: Publisher) -> None:
        self._store, self._publisher = store, publisher
        self._changed = threading.Condition()
        self._waiting: deque[RefusedTrigger] = deque()
        self._beyond = 0
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="station refusals")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()
        with self._changed:
            self._changed.notify_all()
        self._thread.join()

    def add(self, refused: RefusedTrigger) -> None:
        """Take a refused trigger; after the end it is published as not recorded."""
        if refused.part_id is not None:
            refused = refused._replace(part_id=shown_part_id(refused.part_id))
        with self._changed:
            if self._closed.is_set():
                self._tell([refused], recorded=False)
            elif len(self._waiting) < MOST_WAITING:
                self._waiting.append(refused)
            else:
                self._beyond += 1
            self._changed.notify_all()

    def _run(self) -> None:
        is_last = False
        while not is_last:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closed.is_set())
                is_last = self._closed.is_set()
                refused, beyond = list(self._waiting), self._beyond
            if beyond:
                reason = f"{beyond} triggers more than could be recorded one by one"
                refused.append(refused[-1]._replace(part_id=None, reason=reason))
            recorded = self._record(refused)
            if not recorded:
                is_last = self._closed.wait(_RETRY_S)
                if not is_last:
                    continue
            with self._changed:
                for _ in range(len(refused) - bool(beyond)):
                    self._waiting.popleft()
                self._beyond -= beyond
            self._publisher.wait_for_room(self._closed.is_set)
            self._tell(refused, recorded=recorded)
            self._closed.wait(len(refused) / _ROWS_PER_S)

    def _tell(self, refused: list[RefusedTrigger], *, recorded: bool) -> None:
        for each in refused:
            event = TriggerRefused(each.trigger, each.part_id, each.reason, recorded)
            self._publisher.publish(event)

    def _record(self, refused: list[RefusedTrigger]) -> bool:
        try:
            self._store.refuse(*refused)
        except ResultsUnavailable:
            return False
        return True
