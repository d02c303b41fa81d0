"""The clock of a station: UTC for records, with a note if somebody set it."""

import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

from capture.base.utc_time import utc_text

# Smallest step with a note. A time service may slew the clock by 500 ppm as well (adjtime(3)).
_MIN_STEP_S = 2.0
_SLEW_RATE = 5e-4


class StationClock:
    """UTC for records, compared with the monotonic clock, which measures durations."""

    def __init__(
        self,
        utc: Callable[[], datetime] = lambda: datetime.now(UTC),
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._utc, self.monotonic_s = utc, monotonic_s
        self._lock = threading.Lock()
        self._last_utc_s, self._last_monotonic_s = self._read()

    def now(self) -> str:
        """Return the present time, in the form of records."""
        return utc_text(self._utc(), timespec="milliseconds")

    def at(self, monotonic_s: float) -> str:
        """Return the time of a past instant of the monotonic clock, in the form of records."""
        age = timedelta(seconds=self.monotonic_s() - monotonic_s)
        return utc_text(self._utc() - age, timespec="milliseconds")

    def note_if_set(self) -> str | None:
        """Return a note if the clock was set since the last call, else None."""
        with self._lock:
            utc_s, monotonic_s = self._read()
            elapsed_s = monotonic_s - self._last_monotonic_s
            step_s = utc_s - self._last_utc_s - elapsed_s
            self._last_utc_s, self._last_monotonic_s = utc_s, monotonic_s
        if abs(step_s) < _MIN_STEP_S + _SLEW_RATE * elapsed_s:
            return None
        direction = "back" if step_s < 0.0 else "forward"
        return f"the clock was set {direction} by {abs(step_s):.0f} s before this part"

    def _read(self) -> tuple[float, float]:
        return self._utc().timestamp(), self.monotonic_s()
