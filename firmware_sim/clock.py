"""The real clock, and a virtual clock whose sleeps take no time."""

import heapq
import itertools
import threading
import time
from collections.abc import Callable
from typing import Protocol

_TICK_NS = 1_000_000


class Clock(Protocol):
    """A monotonic clock, and waiting on it."""

    def now_s(self) -> float:
        """Time since an arbitrary start; never goes back. May be called with any lock held."""

    def sleep_s(self, duration_s: float) -> None:
        """Return after the duration, or at once if it is zero or negative."""

    def call_at(self, at_s: float, callback: Callable[[], object]) -> None:
        """Call `callback` once at `at_s`, or as soon as possible if that has passed.

        The call comes from a thread of the clock or from one that sleeps, never from this method,
        which may be called with any lock held. `callback` must not sleep on the clock.
        """


class _Agenda:
    """A thread-safe priority queue of calls by time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._order = itertools.count()  # keeps the order of calls at the same time
        self._calls: list[tuple[int, int, Callable[[], object]]] = []

    def add(self, at_ns: int, callback: Callable[[], object]) -> None:
        with self._lock:
            heapq.heappush(self._calls, (at_ns, next(self._order), callback))

    def next_ns(self) -> int | None:
        """The time of the first call, None without one."""
        first = self._calls[:1]  # without the lock, which every tick would take
        return first[0][0] if first else None

    def take(self, now_ns: int) -> Callable[[], object] | None:
        """Remove and return the first call if its time has come."""
        with self._lock:
            if self._calls and self._calls[0][0] <= now_ns:
                return heapq.heappop(self._calls)[2]
            return None


class RealClock:
    """The machine's monotonic clock. A thread runs while calls are waiting."""

    def __init__(self) -> None:
        self._agenda = _Agenda()
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None

    def now_s(self) -> float:
        return time.monotonic()

    def sleep_s(self, duration_s: float) -> None:
        if duration_s > 0:
            time.sleep(duration_s)

    def call_at(self, at_s: float, callback: Callable[[], object]) -> None:
        with self._changed:
            self._agenda.add(round(at_s * 1e9), callback)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="clock", daemon=True)
                self._thread.start()
            self._changed.notify()

    def _run(self) -> None:
        while (callback := self._next_call()) is not None:
            callback()

    def _next_call(self) -> Callable[[], object] | None:
        """Wait for the next call; None ends the thread when no call is left."""
        with self._changed:
            while (next_ns := self._agenda.next_ns()) is not None:
                callback = self._agenda.take(time.monotonic_ns())
                if callback is not None:
                    return callback
                self._changed.wait((next_ns - time.monotonic_ns()) / 1e9)
            self._thread = None
            return None


class VirtualClock:
    """A clock on which time passes only in sleeps, which return at once. Threads share it.

    Time passes in steps of 1 ms at most, so that a watchdog runs at its time.
    """

    def __init__(self, start_s: float = 0.0) -> None:
        # Whole nanoseconds, so that thousands of steps add up without rounding.
        self._now_ns = round(start_s * 1e9)
        self._ticked_ns = self._now_ns
        self._agenda = _Agenda()
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

    def call_at(self, at_s: float, callback: Callable[[], object]) -> None:
        self._agenda.add(round(at_s * 1e9), callback)

    def on_tick(self, callback: Callable[[], object]) -> Callable[[], None]:
        """Call `callback` after each step of time, on the thread that sleeps.

        The returned function ends these calls.
        """

        def unregister() -> None:
            with self._step_lock:
                self._callbacks = tuple(other for other in self._callbacks if other is not callback)

        with self._step_lock:
            self._callbacks = (*self._callbacks, callback)
        return unregister

    def _step_towards(self, deadline_ns: int) -> None:
        # Another thread may have slept past the deadline since it was checked.
        if deadline_ns <= self._now_ns:
            return
        tick_ns = min(deadline_ns, self._ticked_ns + _TICK_NS)
        call_ns = self._agenda.next_ns()
        self._in_tick = True
        try:
            if call_ns is None or call_ns > tick_ns:
                self._now_ns = self._ticked_ns = tick_ns
                for tick in self._callbacks:
                    tick()
            else:
                # A call may have been added for a time in the past, to which the clock must not
                # return.
                self._now_ns = max(self._now_ns, call_ns)
                while (call := self._agenda.take(self._now_ns)) is not None:
                    call()
        finally:
            self._in_tick = False
