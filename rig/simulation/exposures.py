"""When a simulated camera exposes: at its own frame rate, or at each trigger."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass

from firmware_sim import Clock

__all__ = ["TRANSFER_S", "Exposures", "FreeRunning", "Shutter", "Triggered"]

# From the end of the last row's exposure to the frame in the driver's queue: about what
# 1280 x 1024 px of 8 bit take over USB 3.
TRANSFER_S = 0.004
# How often a program that waits for a frame checks whether one was triggered.
_TRIGGER_POLL_S = 0.001
# A clock that slept until a frame was ready may be short of it by its rounding.
_ROUNDING_S = 1e-6

Strobe = Callable[[bool, float], object]


def _no_strobe(_exposing: bool, _at_s: float) -> None:
    pass


@dataclass(frozen=True)
class Shutter:
    """Timing of an exposure.

    Attributes
    ----------
    period_s
        Least time from one exposure to the next.
    exposure_s
        Exposure of each row.
    readout_s
        From the exposure of the first row to that of the last; 0 is a global shutter.
    """

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
    """The exposures of a camera, numbered from 0.

    Parameters
    ----------
    clock
        The rig's.
    shutter
        Timing of each exposure.
    strobe
        The wire that tells whether any row is exposed, with the time of the change.
    """

    def __init__(self, clock: Clock, shutter: Shutter, strobe: Strobe = _no_strobe) -> None:
        self.shutter = shutter
        self._clock = clock
        self._strobe = strobe
        self._open = True
        self._running = 0  # with a rolling shutter exposures may overlap

    @abstractmethod
    def start_s(self, number: int) -> float:
        """Start of an exposure."""

    @abstractmethod
    def finished(self, now_s: float) -> int:
        """How many exposures have their frame in the queue at `now_s`."""

    @abstractmethod
    def ready_s(self, number: int, deadline_s: float) -> float:
        """When the frame of an exposure is in the queue; infinite if not known by the deadline."""

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

    def __init__(self, clock: Clock, shutter: Shutter, strobe: Strobe = _no_strobe) -> None:
        super().__init__(clock, shutter, strobe)
        self._started_s = clock.now_s()
        clock.call_at(self._started_s, lambda: self._run(0))

    def start_s(self, number: int) -> float:
        """Start of an exposure."""
        return self._started_s + number * self.shutter.period_s

    def finished(self, now_s: float) -> int:
        """How many exposures have their frame in the queue at `now_s`."""
        since_s = now_s - self._started_s - self.shutter.ready_after_s + _ROUNDING_S
        return max(0, math.floor(since_s / self.shutter.period_s) + 1)

    def ready_s(self, number: int, deadline_s: float) -> float:
        """When the frame of an exposure is in the queue."""
        del deadline_s
        return self.start_s(number) + self.shutter.ready_after_s

    def _run(self, number: int) -> None:
        if self._open:
            self._expose(self.start_s(number))
            self._clock.call_at(self.start_s(number + 1), lambda: self._run(number + 1))


class Triggered(Exposures):
    """An exposure at each trigger, unless it comes within a frame period of the one before."""

    def __init__(self, clock: Clock, shutter: Shutter, strobe: Strobe = _no_strobe) -> None:
        super().__init__(clock, shutter, strobe)
        self._starts_s: list[float] = []

    def trigger(self) -> None:
        """A pulse on the trigger line, at this moment."""
        now_s = self._clock.now_s()
        if self._starts_s and now_s < self._starts_s[-1] + self.shutter.period_s:
            return
        self._starts_s.append(now_s)
        self._clock.call_at(now_s, lambda: self._expose(now_s))

    def start_s(self, number: int) -> float:
        """Start of an exposure."""
        return self._starts_s[number]

    def finished(self, now_s: float) -> int:
        """How many exposures have their frame in the queue at `now_s`."""
        latest_s = now_s + _ROUNDING_S - self.shutter.ready_after_s
        return bisect_right(self._starts_s, latest_s)

    def ready_s(self, number: int, deadline_s: float) -> float:
        """When the frame of an exposure is in the queue; waits for its trigger."""
        while len(self._starts_s) <= number:
            if self._clock.now_s() >= deadline_s:
                return math.inf
            self._clock.sleep_s(_TRIGGER_POLL_S)
        return self._starts_s[number] + self.shutter.ready_after_s
