"""The clock of a station: UTC for records, with a note if somebody set it."""

import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime

from capture.process.utc_time import utc_text

# Time servers slew a clock by at most 0.5 ms per second: a larger step was made by hand.
_STEP_S = 2.0


def _utc() -> datetime:
    return datetime.now(UTC)


class StationClock:
    """UTC for records, compared with the monotonic clock, which measures durations.

    Parameters
    ----------
    utc, monotonic_s
        The two clocks.
    """

    def __init__(
        self,
        utc: Callable[[], datetime] = _utc,
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._utc, self.monotonic_s = utc, monotonic_s
        self._lock = threading.Lock()
        self._offset_s = self._read_offset_s()

    def now(self) -> str:
        """Return the time as records have it."""
        return utc_text(self._utc(), timespec="milliseconds")

    def step(self) -> str | None:
        """Return a note if the clock was set since the last call, else None."""
        with self._lock:
            before_s, self._offset_s = self._offset_s, self._read_offset_s()
            step_s = self._offset_s - before_s
        if abs(step_s) < _STEP_S:
            return None
        direction = "back" if step_s < 0.0 else "forward"
        return f"the clock was set {direction} by {abs(step_s):.0f} s before this part"

    def _read_offset_s(self) -> float:
        return self._utc().timestamp() - self.monotonic_s()
