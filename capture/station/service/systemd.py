"""Events of a station in the system's journal, and its state for systemd by sd_notify(3).

The protocol is https://systemd.io/JOURNAL_NATIVE_PROTOCOL: a datagram of fields for each entry.
"""

import os
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Self, get_args

from capture.station.domain.verdict import Decision
from capture.station.run.equipment import Worker
from capture.station.run.events import (
    Event,
    PartAnnounced,
    PartRecovered,
    SelfTestFinished,
    State,
    StateChanged,
    StationStopped,
    TriggerRefused,
    Warned,
    json_fields,
    text_lines,
)
from capture.station.run.live_view import LiveEvent
from classify.base.errors import InputError

_SOCKET = Path("/run/systemd/journal/socket")
# Time to wait for the journal to take an entry; after that only station.log has the entry.
_TIMEOUT_S = 1.0
# Priorities of syslog(3).
_ERROR, _WARNING, _NOTICE, _INFO = 3, 4, 5, 6
_PRIORITY_OF_DECISION = {Decision.PASS: _INFO, Decision.ERROR: _WARNING}
# Least time between two pings: workers report several times a second.
_PING_S = 1.0
_WORKERS = set(get_args(Worker))
_OPEN = (State.READY, State.EXECUTING)


def is_connected_to_journal(environment: Mapping[str, str], descriptor: int) -> bool:
    """Whether a descriptor leads to the journal: JOURNAL_STREAM of systemd.exec(5) names it."""
    status = os.fstat(descriptor)
    return environment.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"


class Journal:
    """Subscriber to a station's events that writes them into the journal. Never raises."""

    def __init__(self, station: str, path: Path = _SOCKET) -> None:
        self._station, self._path = station, path

    def tell(self, live: LiveEvent) -> None:
        """Write an event: an entry for each line of text."""
        event = live.event
        fields = [
            ("PRIORITY", str(_priority(event))),
            ("SYSLOG_IDENTIFIER", "ps4rig"),
            ("PS4RIG_STATION", self._station),
            *_fields(event),
        ]
        for line in text_lines(event):
            entry = b"".join(_encoded(*item) for item in (("MESSAGE", line), *fields))
            with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as journal:
                journal.settimeout(_TIMEOUT_S)
                journal.sendto(entry, str(self._path))


def _priority(event: Event) -> int:
    match event:
        case StateChanged(State.ERROR):
            return _ERROR
        case SelfTestFinished(checks):
            statuses = {check.status for check in checks}
            return _ERROR if "fault" in statuses else _INFO if statuses <= {"ok"} else _WARNING
        case Warned() | TriggerRefused():
            return _WARNING
        case PartAnnounced(result, _) | PartRecovered(result):
            return _PRIORITY_OF_DECISION.get(result.verdict.decision, _NOTICE)
        case _:
            return _INFO


def _fields(event: Event) -> Iterator[tuple[str, str]]:
    """Yield fields such as ``PS4RIG_PART_ID``, one for each text, number or element of a list."""
    for key, value in json_fields(event).items():
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, str | int | float):
                yield f"PS4RIG_{key.upper()}", str(item)


def _encoded(name: str, value: str) -> bytes:
    data = value.encode(errors="backslashreplace")
    if b"\n" not in data:
        return f"{name}=".encode() + data + b"\n"
    return f"{name}\n".encode() + struct.pack("<Q", len(data)) + data + b"\n"


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
