"""Events of a station in the system's journal, with fields by which parts are found.

The protocol is https://systemd.io/JOURNAL_NATIVE_PROTOCOL: a datagram of fields for each entry.
"""

import os
import socket
import struct
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from capture.station.domain.verdict import Decision
from capture.station.run.events import (
    Event,
    PartAnnounced,
    PartRecovered,
    SelfTestFinished,
    StateChanged,
    TriggerRefused,
    Warned,
    json_fields,
    text_lines,
)
from capture.station.run.live_view import LiveEvent
from capture.station.run.states import State

_SOCKET = Path("/run/systemd/journal/socket")
# Time to wait for the journal to take an entry; after that only station.log has the entry.
_TIMEOUT_S = 1.0
# Priorities of syslog(3).
_ERROR, _WARNING, _NOTICE, _INFO = 3, 4, 5, 6
_PRIORITY_OF_DECISION = {Decision.PASS: _INFO, Decision.ERROR: _WARNING}


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
