"""Exposure times of a simulated camera: at its own rate, or at each trigger."""

import math
import threading
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass

from firmware_sim import Clock

TRANSFER_S = 0.004
"""Time from the end of the last row's exposure to the frame in the driver's queue: about that of
1280 x 1024 px of 8 bit over USB 3."""
# How often a program that waits for a frame checks whether one was triggered.
_TRIGGER_POLL_S = 0.001
# A clock that slept until a frame was ready may be early by a rounding error.
_ROUNDING_S = 1e-6
# Number of recorded starts, for frames in the driver's buffers: 1,600 sets without a read.
KEPT_STARTS = 8192

_Strobe = Callable[[bool, float], object]


@dataclass(frozen=True)
class Shutter:
    """Frame period, exposure of each row, and readout from the first row to the last."""

    period_s: float
    exposure_s: float
    readout_s: float = 0.0

    @property
    def all_rows_s(self) -> float:
        """From the start of the first row's exposure to the end of the last row's."""
        return self.exposure_s + self.readout_s

    @property
    def ready_after_s(self) -> float:
        """From the start of the exposure to the frame in the driver's queue."""
        return self.all_rows_s + TRANSFER_S


class Exposures(ABC):
    """The exposures of a camera, numbered from 0; `strobe` gets level and time of each edge."""

    def __init__(self, clock: Clock, shutter: Shutter, strobe: _Strobe = lambda *_: None) -> None:
        self.shutter = shutter
        self._clock = clock
        self._strobe = strobe
        self._open = True
        self._running = 0  # exposures; with a rolling shutter they may overlap

    @abstractmethod
    def start_s(self, number: int) -> float:
        """Start of an exposure."""

    @abstractmethod
    def started(self, by_s: float) -> int:
        """Number of exposures that start up to `by_s`."""

    def await_start(self, number: int, deadline_s: float) -> bool:
        """Wait for the start of an exposure to be known; return False at the deadline."""
        del number, deadline_s
        return True

    def trigger(self) -> bool:
        """A pulse on the trigger line, at this moment; whether it starts an exposure."""
        return False

    def close(self) -> None:
        """Start no further exposure."""
        self._open = False

    def _expose(self, start_s: float) -> None:
        if self._running == 0:
            self._strobe(True, start_s)
        self._running += 1
        end_s = start_s + self.shutter.all_rows_s
        self._clock.call_at(end_s, lambda: self._finish(end_s))

    def _finish(self, end_s: float) -> None:
        self._running -= 1
        if self._running == 0:
            self._strobe(False, end_s)


class FreeRunning(Exposures):
    """An exposure in each frame period, from the construction on."""

    def __init__(self, clock: Clock, shutter: Shutter, strobe: _Strobe = lambda *_: None) -> None:
        super().__init__(clock, shutter, strobe)
        self._started_s = clock.now_s()
        clock.call_at(self._started_s, lambda: self._run(0))

    def start_s(self, number: int) -> float:
        """Start of an exposure."""
        return self._started_s + number * self.shutter.period_s

    def started(self, by_s: float) -> int:
        """Number of exposures that start up to `by_s`."""
        periods = (by_s - self._started_s + _ROUNDING_S) / self.shutter.period_s
        return max(0, math.floor(periods) + 1)

    def _run(self, number: int) -> None:
        if self._open:
            self._expose(self.start_s(number))
            self._clock.call_at(self.start_s(number + 1), lambda: self._run(number + 1))


class Triggered(Exposures):
    """An exposure at each trigger that is a frame period after the last exposure."""

    def __init__(self, clock: Clock, shutter: Shutter, strobe: _Strobe = lambda *_: None) -> None:
        super().__init__(clock, shutter, strobe)
        self._lock = threading.Lock()  # a controller triggers while a program reads
        self._starts_s: list[float] = []
        self._forgotten = 0  # exposures before the first of them

    def trigger(self) -> bool:
        """A pulse on the trigger line, at this moment; whether it starts an exposure."""
        now_s = self._clock.now_s()
        with self._lock:
            if self._starts_s and now_s < self._starts_s[-1] + self.shutter.period_s:
                return False
            self._starts_s.append(now_s)
            if len(self._starts_s) == 2 * KEPT_STARTS:
                del self._starts_s[:KEPT_STARTS]
                self._forgotten += KEPT_STARTS
        self._clock.call_at(now_s, lambda: self._expose(now_s))
        return True

    def start_s(self, number: int) -> float:
        """Start of an exposure."""
        with self._lock:
            if number < self._forgotten:
                raise ValueError(f"exposure {number} is older than the kept {len(self._starts_s)}")
            return self._starts_s[number - self._forgotten]

    def started(self, by_s: float) -> int:
        """Number of exposures that start until `by_s`."""
        with self._lock:
            return self._forgotten + bisect_right(self._starts_s, by_s + _ROUNDING_S)

    def await_start(self, number: int, deadline_s: float) -> bool:
        """Whether an exposure is triggered by the deadline."""
        while not (is_known := self._known() > number) and self._clock.now_s() < deadline_s:
            self._clock.sleep_s(_TRIGGER_POLL_S)
        return is_known

    def _known(self) -> int:
        with self._lock:
            return self._forgotten + len(self._starts_s)
