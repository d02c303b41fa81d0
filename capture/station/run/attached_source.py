"""`AttachedSource`: a source of triggers that first attaches the station."""

import threading
from collections.abc import Callable

from capture.station.run.triggers import TriggerSource, TriggerTarget

_POLL_S = 0.2


class AttachedSource:
    """Passes the station to `attach`, then runs a source; without one it waits for the stop."""

    def __init__(
        self, attach: Callable[[TriggerTarget], None], source: TriggerSource | None
    ) -> None:
        self._attach, self._source = attach, source
        self._pause = threading.Event()  # never set: waiting on it can be interrupted

    def run(self, station: TriggerTarget) -> None:
        """Submit triggers until the station stops."""
        self._attach(station)
        if self._source is not None:
            self._source.run(station)
            return
        while not station.is_stopping:
            self._pause.wait(_POLL_S)
