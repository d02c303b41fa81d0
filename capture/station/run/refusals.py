"""`Refusals`: record refused triggers in the results, in the background."""

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from capture.base.utc_time import utc_text
from capture.station.results.database import ResultsUnavailable
from capture.station.results.part_result import shown_part_id
from capture.station.results.store import RefusedTrigger, ResultStore

from .events import TriggerRefused
from .triggers import Trigger

# Largest number that waits. More come only if the database does not answer, or a client is faulty.
MAX_WAITING = 100
# Largest rate, so that a client in a loop does not fill the database: 8 of them made 425 rows a
# second.
_ROWS_PER_S = 20.0
# Pause between two attempts to write to a database that does not answer.
_RETRY_S = 0.5


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
        self._waiting: deque[RefusedTrigger] = deque()
        self._last: RefusedTrigger
        self._overflow = 0
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
        utc = utc_text(timespec="milliseconds")
        refused = RefusedTrigger(trigger.source, utc, reason, False, part_id)
        with self._changed:
            if self._closed.is_set():
                self._publish_all([refused], recorded=False)
                return
            self._last = refused
            if len(self._waiting) < MAX_WAITING:
                self._waiting.append(refused)
            else:
                self._overflow += 1
            self._changed.notify_all()

    def _run(self, store: ResultStore, is_simulated: Callable[[], bool]) -> None:
        is_last = False
        while not is_last:
            with self._changed:
                self._changed.wait_for(
                    lambda: self._waiting or self._overflow or self._closed.is_set()
                )
                is_last = self._closed.is_set()
                refused, overflow = self._rows_to_write()
            simulated = is_simulated()
            recorded = self._record(store, [row._replace(simulated=simulated) for row in refused])
            if not recorded:
                is_last = self._closed.wait(_RETRY_S)
                if not is_last:
                    continue
                with self._changed:
                    refused, overflow = self._rows_to_write()
            with self._changed:
                for _ in range(len(refused) - bool(overflow)):
                    self._waiting.popleft()
                self._overflow -= overflow
            self._wait_for_room(self._closed.is_set)
            self._publish_all(refused, recorded=recorded, overflow=overflow)
            self._closed.wait(len(refused) / _ROWS_PER_S)

    def _rows_to_write(self) -> tuple[list[RefusedTrigger], int]:
        refused, overflow = list(self._waiting), self._overflow
        if overflow:
            reason = f"{overflow} triggers more than could be recorded one by one"
            refused.append(self._last._replace(part_id=None, reason=reason))
        return refused, overflow

    def _publish_all(
        self, refused: list[RefusedTrigger], *, recorded: bool, overflow: int = 0
    ) -> None:
        """Publish rows; the last one stands for `overflow` triggers, if there are any."""
        counts = [1] * len(refused)
        if overflow:
            counts[-1] = overflow
        for row, count in zip(refused, counts, strict=True):
            event = TriggerRefused(row.trigger, row.part_id, row.reason, recorded, count)
            self._publish(event)

    def _record(self, store: ResultStore, refused: list[RefusedTrigger]) -> bool:
        try:
            store.refuse(*refused)
        except ResultsUnavailable:
            return False
        return True
