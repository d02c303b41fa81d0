"""Keep a controller's watchdog quiet in real and simulated time."""

import threading
from collections.abc import Callable

from firmware_sim import Clock

_KeepAlive = Callable[[], float]
"""Sends a command if one is due; returns the seconds until it should be called again."""

# Simulated clocks count whole nanoseconds, so a shorter sleep would not advance them.
_INSTANT_S = 1e-9


class LightUsage:
    """Times of the last commands; a program that uses no light for `unused_s` may hang."""

    def __init__(self, clock: Clock, watchdog_ms: int, unused_s: float) -> None:
        self._clock = clock
        self._unused_s = unused_s
        self.period_s = watchdog_ms / 2000.0  # half the watchdog's time-out
        self.mark_used()

    @property
    def due_in_s(self) -> float:
        """Seconds until the next command is due; negative if it is overdue."""
        return self._sent_s + self.period_s - self._clock.now_s()

    @property
    def is_recent(self) -> bool:
        """Whether the thread that used the lights last still runs, and used them recently."""
        return self._user_thread.is_alive() and self._clock.now_s() - self._used_s <= self._unused_s

    def mark_used(self) -> None:
        """Note a command of the program."""
        self._user_thread = threading.current_thread()
        self._used_s = self._sent_s = self._clock.now_s()

    def mark_sent(self) -> None:
        """Note a command that only keeps the watchdog quiet."""
        self._sent_s = self._clock.now_s()


class KeepAliveThread:
    """A thread that calls `keep_alive`, which must not raise, in real time until it is stopped."""

    def __init__(self, keep_alive: _KeepAlive) -> None:
        self._keep_alive = keep_alive
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="light keep-alive", daemon=True)
        self._thread.start()

    def stop(self, timeout_s: float) -> None:
        """Make no further call, and wait up to `timeout_s` for one that runs."""
        self._stopping.set()
        if self._thread is not threading.current_thread():
            self._thread.join(timeout_s)

    def _run(self) -> None:
        while not self._stopping.wait(self._keep_alive()):
            pass


class KeepAliveClock:
    """A clock whose sleeps also keep a controller alive, for simulated time."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._keep_alive: _KeepAlive | None = None

    def keep_alive_with(self, keep_alive: _KeepAlive | None) -> None:
        """Call `keep_alive` in every sleep, as often as it asks; None stops the calls."""
        self._keep_alive = keep_alive

    def now_s(self) -> float:
        return self._clock.now_s()

    def sleep_s(self, duration_s: float) -> None:
        end_s = self._clock.now_s() + duration_s
        while (left_s := end_s - self._clock.now_s()) > _INSTANT_S:
            pause_s = left_s if self._keep_alive is None else min(left_s, self._keep_alive())
            self._clock.sleep_s(max(pause_s, _INSTANT_S))

    def call_at(self, at_s: float, callback: Callable[[], object]) -> None:
        self._clock.call_at(at_s, callback)
