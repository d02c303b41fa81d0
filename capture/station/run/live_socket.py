"""The live socket: a run's state and events for panels, and their requests, on a Unix socket.

A panel reads lines of JSON: the state, then each event as ``station run --json`` prints it, with
its position and the fields of the state that it changes. It writes requests, each of which is
answered by its number.
"""

import logging
import os
import socket
import struct
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter

from capture.station.domain.errors import CannotListen, error_text
from capture.station.domain.folder import StationFolder
from capture.station.results.audit import ResultsAccess
from capture.station.results.database import ResultsUnavailable
from capture.station.run.events import JsonEvent, RecipeLoaded
from classify.base.models import Record

from .live_station import LiveStation
from .live_view import STATE
from .triggers import Accepted, Asker, RecipeRefusal, RecipeRefused, Refused, Trigger

NAME = "live.sock"
MAX_PANELS = 8
# Largest request: a change has two texts of 2000 characters, which JSON escapes in up to 12 bytes
# each.
MAX_REQUEST_BYTES = 1 << 16
# Largest number of requests of one panel that wait for the station; others wait in the socket.
_MAX_REQUESTS = 16
# Time after which a panel that reads nothing is disconnected.
SEND_TIME = struct.pack("ll", 5, 0)  # timeval: seconds, microseconds
_CREDENTIALS = struct.Struct("3i")  # ucred of unix(7): process, user, group
TRIGGER = TypeAdapter(Trigger)
_log = logging.getLogger(__name__)


class _Request(Record):
    """A numbered call of `LiveStation`, ``announce``, ``append``, or ``withdraw``.

    ``announce`` publishes an action in the panel, ``append`` writes rows. ``withdraw`` reports that
    the client of a trigger is gone, and has no reply.
    """

    id: int
    call: Literal["submit", "load_recipe", "acknowledge", "announce", "append", "withdraw"]
    arguments: tuple[Any, ...]


class Reply(Record):
    """The answer to a request, after all events before it."""

    id: int
    value: Accepted | Refused | RecipeLoaded | bool | None = None
    refused: RecipeRefusal | None = None  # why a recipe is not loaded
    reason: str = ""


@contextmanager
def live_address(folder: Path) -> Iterator[str]:
    """Yield the address of a station's socket.

    On Linux it uses the folder's descriptor, because an address has at most 107 bytes.
    """
    with ExitStack() as stack:
        if not Path("/proc/self/fd").is_dir():
            yield str(folder / NAME)
            return
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        stack.callback(os.close, descriptor)
        yield f"/proc/self/fd/{descriptor}/{NAME}"


@contextmanager
def serving_live(folder: StationFolder, live: LiveStation) -> Iterator[None]:
    """Serve the socket of a run while the block runs; the folder is locked for this run."""
    with ExitStack() as stack:
        results = stack.enter_context(closing(ResultsAccess(folder)))
        try:
            listener = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            address = stack.enter_context(live_address(folder.path))
            Path(address).unlink(missing_ok=True)  # of a run that was killed
            listener.bind(address)
            stack.callback(partial(Path(address).unlink, missing_ok=True))
            Path(address).chmod(0o600)
            listener.listen(MAX_PANELS)
        except (AttributeError, OSError) as error:  # Windows has no such sockets
            raise CannotListen(f"{folder.path / NAME}: {error}") from error
        accepting = threading.Thread(
            target=_accept, args=(listener, live, results), name="live socket"
        )
        accepting.start()
        try:
            yield
        finally:
            live.close()
            listener.shutdown(socket.SHUT_RDWR)
            accepting.join()


def _accept(listener: socket.socket, live: LiveStation, results: ResultsAccess) -> None:
    panels: list[threading.Thread] = []
    while True:
        try:
            connection, _ = listener.accept()
        except OSError:  # the end of the run
            break
        panels = [panel for panel in panels if panel.is_alive()]
        if len(panels) >= MAX_PANELS or not _is_own(connection):
            connection.close()
            continue
        serve = _Panel(connection, live, results).serve
        panels.append(threading.Thread(target=serve, name="live panel"))
        panels[-1].start()
    for panel in panels:
        panel.join()


def _is_own(connection: socket.socket) -> bool:
    """Whether the peer is this user; without SO_PEERCRED the mode of the file ensures it."""
    if not hasattr(socket, "SO_PEERCRED"):
        return True
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    return bool(_CREDENTIALS.unpack(credentials)[1] == os.geteuid())


class _Panel:
    """A connected panel: a thread sends, one reads, and some wait for the station."""

    def __init__(
        self, connection: socket.socket, live: LiveStation, results: ResultsAccess
    ) -> None:
        self._connection, self._live, self._results = connection, live, results
        self._woken = threading.Event()
        self._subscription = live.subscribe(self._woken.set)
        self._sending = threading.Lock()
        self._has_ended = False
        self._withdrawn: set[int] = set()  # requests whose client is gone

    def serve(self) -> None:
        """Send the state and all events until one side ends, or the panel is too slow."""
        snapshot = self._live.snapshot()
        reading = threading.Thread(target=self._read, name="live requests")
        with self._connection:
            self._connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, SEND_TIME)
            with suppress(OSError):
                self._connection.sendall(
                    b'{"snapshot":%s}\n' % STATE.dump_json(snapshot, warnings=False)
                )
            reading.start()
            while not self._has_ended:
                self._woken.wait()
                self._woken.clear()
                # Checked before the last events are sent, because no event comes after the closing.
                if self._subscription.is_closed:
                    self._has_ended = True
                self._send(b"")
            self._live.unsubscribe(self._subscription)
            with suppress(OSError):
                self._connection.shutdown(socket.SHUT_RDWR)
            reading.join()

    def _send(self, reply: bytes) -> None:
        """Send the waiting events, then a reply; a panel that lost events must connect again."""
        with self._sending:
            events, lost_count = self._subscription.take()
            try:
                self._connection.sendall(b"".join(event.as_line for event in events) + reply)
            except OSError:
                lost_count = 1
            if lost_count:
                self._has_ended = True
                self._woken.set()

    def _read(self) -> None:
        free = threading.BoundedSemaphore(_MAX_REQUESTS)
        with (
            ThreadPoolExecutor(_MAX_REQUESTS, "request of a panel") as pool,
            suppress(OSError, ValueError),
            self._connection.makefile("rb") as lines,
        ):
            while (line := lines.readline(MAX_REQUEST_BYTES)).endswith(b"\n"):
                request = _Request.model_validate_json(line)
                if request.call == "withdraw":
                    self._withdrawn.add(request.arguments[0])
                    continue
                free.acquire()
                pool.submit(self._answer, request).add_done_callback(lambda _: free.release())
        self._has_ended = True
        self._woken.set()

    def _answer(self, request: _Request) -> None:
        try:
            outcome: dict[str, Any] = {"value": self._call(request)}
        except RecipeRefused as error:
            outcome = {"refused": error.kind, "reason": str(error)}
        except ResultsUnavailable as error:
            outcome = {"reason": str(error)}
        except Exception as error:
            _log.exception("a request of a panel")
            outcome = {"refused": RecipeRefusal.UNFORESEEN, "reason": error_text(error)}
        self._withdrawn.discard(request.id)
        reply = Reply(id=request.id, **outcome)
        self._send(b'{"reply":%s}\n' % reply.model_dump_json().encode())

    def _call(self, request: _Request) -> Accepted | Refused | RecipeLoaded | bool | None:
        live = self._live
        match request.call, request.arguments:
            case "submit", (fields,):
                trigger = TRIGGER.validate_python(fields)
                withdrawn = self._withdrawn
                return live.submit(replace(trigger, is_withdrawn=lambda: request.id in withdrawn))
            case "load_recipe", (name, by):
                return live.load_recipe(name, Asker(*by))
            case "acknowledge", (part_id, by):
                return live.acknowledge(part_id, by)
            case "announce", (fields,):
                live.publish(JsonEvent(fields))
            case "append", (table, rows, of_part):
                self._results.opened_or_created().append_rows(table, rows, of_part)
                return True
        return None
