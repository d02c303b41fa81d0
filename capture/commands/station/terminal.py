"""A station on the terminal: a line for each part, or a line of JSON for each event."""

import os
import sys

from capture.base.console import complain, out
from capture.station.run.events import Warned, text_lines
from capture.station.run.live_station import Subscriber
from capture.station.run.live_view import LiveEvent
from capture.station.service.systemd import Journal, is_connected_to_journal

_STDOUT = 1


def shown_by(station: str, *, as_json: bool) -> Subscriber:
    """Return a subscriber that prints events, or writes the journal if stdout leads there."""
    if as_json:
        return _print_event_as_json
    if is_connected_to_journal(os.environ, _STDOUT):
        return Journal(station).tell
    return _print_event


def _print_event(live: LiveEvent) -> None:
    """Print an event for people; warnings go to stderr."""
    for line in text_lines(live.event):
        if isinstance(live.event, Warned):
            complain(line)
        else:
            out.print(line)


def _print_event_as_json(live: LiveEvent) -> None:
    """Print an event as one line of JSON, at once."""
    print(live.as_json, flush=True)


def read_key_line() -> str:
    """Read a line from the keyboard; the program can end while it waits."""
    # Unbuffered: a thread that waits in a buffered reader would hold its lock at the end.
    with open(sys.stdin.fileno(), "rb", buffering=0, closefd=False) as keys:
        return keys.readline().decode(errors="replace")
