"""`AttachedSource`: triggers of a run whose station other triggers reach, too."""

import threading
from collections.abc import Callable

from capture.station.cycle.triggers import TriggerSource, TriggerTarget

_POLL_S = 0.2


class AttachedSource:
    """A source of triggers that tells somebody of its station first; None waits for its end."""

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
