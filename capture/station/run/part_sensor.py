"""The part sensor as a source of triggers, served by the thread that captures."""

from collections.abc import Callable

from capture.station.results.store import ResultStore

from .station_rig import StationRig
from .triggers import Refused, Trigger, TriggerTarget

_SOURCE = "sensor"
_MISSED = "passed the sensor while the station was busy or not ready"
# Each row takes a transaction of some 4 ms; more parts at once are a sensor out of order.
MOST_RECORDED = 100


class PartSensor:
    """The sensor at the light controller of a rig; each part that it sees is a trigger."""

    def __init__(self, rig: StationRig, store: ResultStore) -> None:
        self._rig, self._store = rig, store

    def await_part(self, station: TriggerTarget, is_over: Callable[[], bool]) -> None:
        """Wait for a part and submit its trigger, unless `is_over`.

        Parts that came since the last wait are refused, with a row each up to `MOST_RECORDED`.
        """
        missed = self._rig.missed_parts()
        for _ in range(min(missed, MOST_RECORDED)):
            if is_over():  # each row may wait for a locked database
                break
            station.refuse(Trigger(_SOURCE), f"the part {_MISSED}")
            missed -= 1
        if missed > 0:
            station.refuse(Trigger(_SOURCE), f"parts that {_MISSED}: {missed}")
        has_come = self._rig.wait_for_part(self._store.last_number() + 1, is_over)
        if has_come and isinstance(station.submit(Trigger(_SOURCE)), Refused):
            self._rig.forget_part()
