"""Time for everything simulated: the real clock, or a virtual one that nobody has to wait for."""

import threading
import time
from collections.abc import Callable
from typing import Protocol

__all__ = ["Clock", "RealClock", "VirtualClock"]

_TICK_NS = 1_000_000


class Clock(Protocol):
    """A monotonic clock and the one way to wait on it."""

    def now_s(self) -> float:
        """Time since an arbitrary start; it never goes back. May be called with any lock held."""

    def sleep_s(self, duration_s: float) -> None:
        """Return when the duration has passed; at once if it is zero or negative."""


class RealClock:
    """The machine's own monotonic clock."""

    def now_s(self) -> float:
        return time.monotonic()

    def sleep_s(self, duration_s: float) -> None:
        if duration_s > 0:
            time.sleep(duration_s)


class VirtualClock:
    """A clock on which time passes only while somebody sleeps, and then at once.

    A sleep moves the time in steps of at most 1 ms and calls every tick callback after each step,
    so that what would run in a main loop (a watchdog) runs at its simulated time. Threads may
    sleep together: each returns when the common time has reached its own deadline.

    Parameters
    ----------
    start_s
        The time it shows at first.
    """

    def __init__(self, start_s: float = 0.0) -> None:
        # whole nanoseconds: thousands of steps add up without rounding
        self._now_ns = round(start_s * 1e9)
        self._callbacks: tuple[Callable[[], object], ...] = ()
        self._step_lock = threading.RLock()
        self._in_tick = False

    def now_s(self) -> float:
        return self._now_ns / 1e9

    def sleep_s(self, duration_s: float) -> None:
        deadline_ns = self._now_ns + round(duration_s * 1e9)
        while self._now_ns < deadline_ns:
            with self._step_lock:
                if self._in_tick:
                    raise RuntimeError("a tick callback of a virtual clock must not sleep on it")
                self._step_towards(deadline_ns)

    def on_tick(self, callback: Callable[[], object]) -> Callable[[], None]:
        """Call `callback` after each step of time, on the thread that sleeps.

        Returns
        -------
        Callable
            Unregisters the callback; once it has returned, the callback is not called again.
        """

        def unregister() -> None:
            with self._step_lock:
                self._callbacks = tuple(c for c in self._callbacks if c is not entry)

        def entry() -> None:  # a name of its own, so that one callback may be registered twice
            callback()

        with self._step_lock:
            self._callbacks = (*self._callbacks, entry)
        return unregister

    def _step_towards(self, deadline_ns: int) -> None:
        # another sleeper may have come past the deadline since it was last looked at
        remaining_ns = deadline_ns - self._now_ns
        if remaining_ns <= 0:
            return
        self._now_ns += min(_TICK_NS, remaining_ns)
        self._in_tick = True
        try:
            for callback in self._callbacks:
                callback()
        finally:
            self._in_tick = False
