"""`Beginning`: the row of a part, written within the time that its trigger is good for."""

from concurrent.futures import ThreadPoolExecutor

from capture.station.results.database import ResultsUnavailable, safe_url
from capture.station.results.store import BegunPart, ResultStore

from .station_clock import StationClock
from .triggers import Trigger, TriggerTooLate


class Beginning:
    """Begins parts in a thread of its own, which the caller waits for no longer than `limit_s`."""

    def __init__(self, store: ResultStore, clock: StationClock, limit_s: float) -> None:
        self._store, self._clock, self._limit_s = store, clock, limit_s
        self._writer = ThreadPoolExecutor(1, "station trigger")

    def close(self) -> None:
        """Begin no further part; do not wait for one that the database holds up."""
        self._writer.shutdown(wait=False, cancel_futures=True)

    def require_timely(self, trigger: Trigger) -> None:
        """Raise TriggerTooLate if another part may lie below the camera by now."""
        age_s = self._clock.monotonic_s() - trigger.at_s
        if age_s > self._limit_s:
            raise TriggerTooLate(
                f"late: the trigger is {age_s:.2f} s old, max_trigger_age_s is {self._limit_s:g}"
            )

    def begin(self, trigger: Trigger, *, is_simulated: bool) -> BegunPart:
        """Record a part, if its client still waits.

        A row that is written after `ResultsUnavailable` becomes an ERROR in the next self-test.
        """

        def require() -> None:
            self.require_timely(trigger)
            if trigger.is_withdrawn():
                raise TriggerTooLate("its client is gone")

        require()
        beginning = self._writer.submit(
            self._store.begin,
            trigger=trigger.source,
            triggered_utc=self._clock.now(),
            simulated=is_simulated,
            part_id=trigger.part_id,
            require=require,
        )
        try:
            return beginning.result(self._limit_s)
        except TimeoutError as error:
            beginning.cancel()
            text = f"{safe_url(self._store.url)}: no answer in {self._limit_s:g} s"
            raise ResultsUnavailable(text) from error
