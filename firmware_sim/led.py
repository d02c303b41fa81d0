"""The light of one simulated LED at a time and over an exposure."""

import math
from collections import deque
from dataclasses import dataclass
from typing import Protocol

# The history reaches back to the oldest frame in a camera's buffers. A set switches an LED twice:
# 8192 switches cover 4,000 sets of which no frame is read, and take 1.3 MB for each LED.
_HISTORY_EVENTS = 8192
_TAU_PER_10_90 = 1.0 / math.log(9.0)  # an exponential goes from 10 % to 90 % in tau * ln 9


@dataclass(frozen=True, slots=True)
class _Segment:
    """The exponential approach from one switch event to the next."""

    since_s: float
    start: float
    target: float
    tau_s: float

    def output(self, at_s: float) -> float:
        return self.target + self._excess(at_s)

    def integral_s(self, begin_s: float, end_s: float) -> float:
        steady_s = self.target * (end_s - begin_s)
        if self.tau_s == 0.0:
            return steady_s
        decay = -math.expm1((begin_s - end_s) / self.tau_s)
        return steady_s + self._excess(begin_s) * self.tau_s * decay

    def _excess(self, at_s: float) -> float:
        """Difference of the output from its target."""
        if self.tau_s == 0.0:
            return 0.0
        return (self.start - self.target) * math.exp((self.since_s - at_s) / self.tau_s)


class LedLight(Protocol):
    """The interface of an LED on a board."""

    def drive(self, percent: int, at_s: float) -> None:
        """Set the drive; `at_s` must not be earlier than that of the last call."""

    def output(self, at_s: float) -> float:
        """Return the relative output at a time."""

    def output_integral_s(self, start_s: float, end_s: float) -> float:
        """Return the integral of the output over an interval, in seconds of full output."""


class Led:
    """Relative optical output (0 to 1) of one LED over time, from its switch history."""

    def __init__(self, rise_ms: float, fall_ms: float) -> None:
        self._rise_tau_s = rise_ms / 1000.0 * _TAU_PER_10_90
        self._fall_tau_s = fall_ms / 1000.0 * _TAU_PER_10_90
        self._history = deque([_Segment(-math.inf, 0.0, 0.0, 0.0)], maxlen=_HISTORY_EVENTS)

    def drive(self, percent: int, at_s: float) -> None:
        """Set the level, 0 to 100, from a time on; times must not decrease."""
        before = self._history[-1]
        target = percent / 100.0
        if target == before.target:
            return  # the current approach continues
        start = before.output(at_s)
        tau_s = self._rise_tau_s if target > start else self._fall_tau_s
        self._history.append(_Segment(at_s, start, target, tau_s))

    def output(self, at_s: float) -> float:
        """Return the relative output at a time; ValueError before the history begins."""
        for segment in reversed(self._history):
            if segment.since_s <= at_s:
                return segment.output(at_s)
        raise self._forgotten(at_s)

    def output_integral_s(self, start_s: float, end_s: float) -> float:
        """Return the integral of the output in seconds of full output; errors as `output`."""
        total_s = 0.0
        for segment in reversed(self._history):
            if segment.since_s < end_s:
                begin_s = max(start_s, segment.since_s)
                total_s += segment.integral_s(begin_s, end_s)
                end_s = begin_s
            if segment.since_s <= start_s:
                return total_s
        raise self._forgotten(start_s)

    def _forgotten(self, at_s: float) -> ValueError:
        first_s = self._history[0].since_s
        return ValueError(f"the LED's history starts at {first_s:.6f} s, after {at_s:.6f} s")
