"""Report the state of a station to systemd, by the protocol of sd_notify(3)."""

import os
import socket
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Self, get_args

from capture.station.run.equipment import Worker
from capture.station.run.events import StationStopped
from capture.station.run.live_view import LiveEvent
from capture.station.run.states import State
from classify.base.errors import InputError

# Least time between two pings: workers report several times a second.
_PING_S = 1.0
_WORKERS = set(get_args(Worker))
_OPEN = (State.READY, State.EXECUTING)


class Notifier:
    """Subscriber to a station's events, which pings the watchdog when all workers have reported.

    It never blocks or raises.
    """

    def __init__(
        self,
        address: str | None,
        watchdog_s: float | None = None,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        if address is not None and not address.startswith(("/", "@")):
            raise InputError(f"NOTIFY_SOCKET={address}: give an absolute path or @NAME")
        self._address = address
        self._ping_s = None if watchdog_s is None else min(_PING_S, watchdog_s / 4)
        self._now_s = now_s
        # Guards everything below.
        self._lock = threading.Lock()
        self._alive: set[Worker] = set()
        self._pinged_s = -float("inf")
        self._is_ready = False
        self._lines: tuple[str, ...] = ()  # that were sent last

    @classmethod
    def from_environment(cls, environment: Mapping[str, str]) -> Self:
        """Return the notifier for the variables that systemd sets for a service."""
        address = environment.get("NOTIFY_SOCKET") or None
        usec, process = environment.get("WATCHDOG_USEC"), environment.get("WATCHDOG_PID")
        if usec is None or process not in (None, str(os.getpid())):
            return cls(address)
        if not usec.isdecimal() or int(usec) == 0:
            raise InputError(f"WATCHDOG_USEC={usec}: give a number of microseconds")
        return cls(address, int(usec) / 1e6)

    def tell(self, live: LiveEvent) -> None:
        """Report the state after an event of the station."""
        state = live.state
        with self._lock:
            self._is_ready |= state.state is State.READY
            phase = State.READY if state.state in _OPEN else f"{state.state}: {state.reason}"
            is_over = isinstance(live.event, StationStopped)
            status = f"STATUS={'stopped: ' + state.reason if is_over else phase}; parts: "
            status += str(sum(state.announced.values()))
            if state.last is not None:
                status += f", the last {state.last.part_id} {state.last.verdict.decision}"
            lines = ("READY=1", status) if self._is_ready else (status,)
            if is_over:
                lines = ("STOPPING=1", *lines)
            if lines != self._lines:
                self._send(*lines)
                self._lines = lines

    def report_alive(self, worker: Worker) -> None:
        """Note that a worker is alive."""
        with self._lock:
            self._alive.add(worker)
            if self._ping_s is None or not self._is_ready or self._alive != _WORKERS:
                return
            if self._now_s() >= self._pinged_s + self._ping_s:
                # Send the whole state: an earlier datagram may have been lost.
                self._send("WATCHDOG=1", *self._lines)
                self._alive.clear()
                self._pinged_s = self._now_s()

    def _send(self, *lines: str) -> None:
        if self._address is None:
            return
        text = "\n".join(" ".join(line.split()) for line in lines)
        address = self._address.replace("@", "\0", 1) if self._address[0] == "@" else self._address
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as to_systemd:
            to_systemd.setblocking(False)
            to_systemd.sendto(text.encode(errors="backslashreplace"), address)
