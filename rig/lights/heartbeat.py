"""Calling a controller often enough while nobody else does, in real and in simulated time."""

from __future__ import annotations

import threading
from collections.abc import Callable

from firmware_sim import Clock

__all__ = ["Heartbeat", "Tend", "TendedClock"]

Tend = Callable[[], float]
"""Does what is due; returns after how many seconds it wants to be called again."""

# Simulated clocks count whole nanoseconds: less than one is no time.
_INSTANT_S = 1e-9


class Heartbeat:
    """A thread that tends in real time until it is stopped.

    Parameters
    ----------
    tend
        Called from the thread; it must have a deadline of its own and must not raise.
    """

    def __init__(self, tend: Tend) -> None:
        self._tend = tend
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="light heartbeat", daemon=True)
        self._thread.start()

    def stop(self, timeout_s: float) -> None:
        """Let a call that runs come to its end, for so long at most; no other follows."""
        self._stopping.set()
        if self._thread is not threading.current_thread():
            self._thread.join(timeout_s)

    def _run(self) -> None:
        while not self._stopping.wait(self._tend()):
            pass


class TendedClock:
    """Another clock, on which who sleeps also tends: with simulated time nobody else could.

    Threads know nothing of a time that passes at once, and a tick of a virtual clock must not wait
    for an answer that itself takes simulated time. The hardware below keeps to the inner clock.

    Parameters
    ----------
    clock
        Whose time it shows.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._tend: Tend | None = None

    def attend(self, tend: Tend | None) -> None:
        """Call `tend` in every sleep from here on, as often as it asks for; None ends that."""
        self._tend = tend

    def now_s(self) -> float:
        return self._clock.now_s()

    def sleep_s(self, duration_s: float) -> None:
        end_s = self._clock.now_s() + duration_s
        while (remaining_s := end_s - self._clock.now_s()) > _INSTANT_S:
            pause_s = remaining_s if self._tend is None else min(remaining_s, self._tend())
            self._clock.sleep_s(max(pause_s, _INSTANT_S))

    def call_at(self, at_s: float, callback: Callable[[], object]) -> Callable[[], None]:
        return self._clock.call_at(at_s, callback)
