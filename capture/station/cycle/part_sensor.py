"""The part sensor as a source of triggers, served by the thread that captures."""

from collections.abc import Callable

from capture.station.results.store import ResultStore

from .station_rig import StationRig
from .triggers import Refused, Trigger, TriggerTarget

_SOURCE = "sensor"
_MISSED = "the part passed the sensor while the station was busy or not ready"


class PartSensor:
    """The sensor at the light controller of a rig; each part that it sees is a trigger.

    Parameters
    ----------
    rig
        The rig, which is open while a part is awaited.
    store
        Gives the number of the next part.
    """

    def __init__(self, rig: StationRig, store: ResultStore) -> None:
        self._rig, self._store = rig, store

    def await_part(self, station: TriggerTarget, is_over: Callable[[], bool]) -> None:
        """Wait for a part and submit its trigger, unless `is_over`.

        Parts that came since the last wait are refused, so that they are on record.

        Raises
        ------
        HardwareError, InputError
            If the controller fails or cannot wait for parts.
        ResultsUnavailable
            If the database does not answer.
        """
        for _ in range(self._rig.missed_parts()):
            station.refuse(Trigger(_SOURCE), _MISSED)
        has_come = self._rig.wait_for_part(self._store.last_number() + 1, is_over)
        if has_come and isinstance(station.submit(Trigger(_SOURCE)), Refused):
            self._rig.forget_part()
