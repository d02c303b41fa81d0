"""`Beginning`: record triggered parts, each before its trigger is too old."""

from concurrent.futures import ThreadPoolExecutor

from capture.station.results.database import ResultsUnavailable, safe_url
from capture.station.results.store import BegunPart, ResultStore

from .station_clock import StationClock
from .triggers import Trigger, TriggerTooLate


class Beginning:
    """Records triggered parts in a thread of its own; a caller waits at most `max_age_s` for it."""

    def __init__(self, store: ResultStore, clock: StationClock, max_age_s: float) -> None:
        self._store, self._clock, self._max_age_s = store, clock, max_age_s
        self._writer = ThreadPoolExecutor(1, "station trigger")

    def close(self) -> None:
        """Begin no further part; do not wait for a locked database."""
        self._writer.shutdown(wait=False, cancel_futures=True)

    def require_timely(self, trigger: Trigger) -> None:
        """Raise TriggerTooLate if another part may lie below the camera by now."""
        age_s = self._clock.monotonic_s() - trigger.at_s
        if age_s > self._max_age_s:
            raise TriggerTooLate(
                f"late: the trigger is {age_s:.2f} s old, max_trigger_age_s is {self._max_age_s:g}"
            )

    def begin(self, trigger: Trigger, *, is_simulated: bool) -> BegunPart:
        """Record a part, if its client still waits.

        If the row is written after this raised `ResultsUnavailable`, the next self-test makes the
        part an ERROR.
        """

        def require_awaited() -> None:
            self.require_timely(trigger)
            if trigger.is_withdrawn():
                raise TriggerTooLate("its client is gone")

        require_awaited()
        part = self._writer.submit(
            self._store.begin,
            trigger=trigger.source,
            triggered_utc=self._clock.now(),
            simulated=is_simulated,
            part_id=trigger.part_id,
            require=require_awaited,
        )
        try:
            return part.result(self._max_age_s)
        except TimeoutError as error:
            part.cancel()
            text = f"{safe_url(self._store.url)}: no answer in {self._max_age_s:g} s"
            raise ResultsUnavailable(text) from error
