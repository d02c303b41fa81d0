"""The clock of a station: UTC for records, with a note if somebody set it."""

import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

from capture.base.utc_time import utc_text

# Smaller steps get no note: a time service corrects the clock by up to 500 ppm (adjtime(3)).
_STEP_S = 2.0
_SLEW_RATE = 5e-4


def _utc() -> datetime:
    return datetime.now(UTC)


class StationClock:
    """UTC for records, compared with the monotonic clock, which measures durations."""

    def __init__(
        self,
        utc: Callable[[], datetime] = _utc,
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._utc, self.monotonic_s = utc, monotonic_s
        self._lock = threading.Lock()
        self._read_s = self._read()

    def now(self) -> str:
        """Return the present time, in the form of records."""
        return utc_text(self._utc(), timespec="milliseconds")

    def at(self, monotonic_s: float) -> str:
        """Return the time of a past instant of the monotonic clock, in the form of records."""
        passed = timedelta(seconds=self.monotonic_s() - monotonic_s)
        return utc_text(self._utc() - passed, timespec="milliseconds")

    def step(self) -> str | None:
        """Return a note if the clock was set since the last call, else None."""
        with self._lock:
            (utc_s, monotonic_s), self._read_s = self._read_s, self._read()
            passed_s = self._read_s[1] - monotonic_s
            step_s = self._read_s[0] - utc_s - passed_s
        if abs(step_s) < _STEP_S + _SLEW_RATE * passed_s:
            return None
        direction = "back" if step_s < 0.0 else "forward"
        return f"the clock was set {direction} by {abs(step_s):.0f} s before this part"

    def _read(self) -> tuple[float, float]:
        return self._utc().timestamp(), self.monotonic_s()
