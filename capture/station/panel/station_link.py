"""`StationLink`: a running station as a panel in another process sees it."""

import itertools
import json
import logging
import socket
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from typing import Any

from capture.station.domain.folder import StationFolder
from capture.station.results.database import ResultsUnavailable
from capture.station.run.events import RecipeLoaded, State
from capture.station.run.live_socket import TRIGGER, Reply, live_address
from capture.station.run.live_view import STATE, LiveEvent, LiveView
from capture.station.run.station_state import StationState
from capture.station.run.triggers import Answer, Asker, RecipeRefused, Trigger
from classify.base.errors import InputError

NO_RUN = "no connection to the run"
_RECONNECT_S = 0.2
# Interval of checks whether the client of a trigger has left.
_WITHDRAWN_POLL_S = 0.05
# Time that `close` waits for the last events of a run that ends.
_LAST_EVENTS_S = 1.0
# Length of a line. The longest, a snapshot, has the results of 13 parts, each with its defects.
_MAX_LINE_BYTES = 1 << 24
_log = logging.getLogger(__name__)


class RunUnavailable(ResultsUnavailable):
    """No run answers: there is none, or it ended before its answer."""


class StationLink(LiveView):
    """Follows the live socket of a station, also across ends and starts of its runs."""

    def __init__(self, folder: StationFolder) -> None:
        config = folder.config
        try:
            is_simulated = folder.rig_config().is_simulated
        except InputError:
            is_simulated = False
        super().__init__(StationState(config.name, is_simulated, config.trigger, (), NO_RUN))
        self._folder = folder.path
        self._ending = threading.Event()
        self._sending = threading.Lock()  # guards the three below
        self._connection: socket.socket | None = None
        self._numbers = itertools.count(1)
        self._replies: dict[int, Future[Reply]] = {}
        self._thread = threading.Thread(target=self._run, name="live socket", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Wait for the last events of a run that ends, and end all subscriptions."""
        self._ending.set()
        with self._sending, suppress(OSError):
            if self._connection is not None:
                self._connection.shutdown(socket.SHUT_WR)  # the run closes it after its last event
        self._thread.join(_LAST_EVENTS_S)
        super().close()

    def submit(self, trigger: Trigger) -> Answer:
        """Pass a trigger to the station, or raise RunUnavailable."""
        fields = TRIGGER.dump_python(trigger)
        value = self._call_run("submit", fields, is_withdrawn=trigger.is_withdrawn).value
        if not isinstance(value, Answer):
            raise RunUnavailable("the run has an unforeseen error; see its log")
        return value

    def load_recipe(self, name: str, by: Asker) -> RecipeLoaded:
        """Let the station load a recipe; all parts triggered after the return are judged by it."""
        reply = self._call_run("load_recipe", name, by)
        if reply.refused is not None:
            raise RecipeRefused(reply.reason, reply.refused)
        assert isinstance(reply.value, RecipeLoaded)
        return reply.value

    def acknowledge(self, part_id: str | None, by: str) -> bool:
        """Record that somebody has seen a rejected part, or the fault that stops the line."""
        return self._call_run("acknowledge", part_id, by).value is True

    def append(self, table: str, rows: list[dict[str, Any]], of_part: str | None) -> bool:
        """Let the run append rows, or raise ResultsUnavailable; return False without a run."""
        # A panel that is stopped while it appends would keep the lock of the database.
        try:
            reply = self._call_run("append", table, rows, of_part)
        except RunUnavailable:
            return False
        if reply.value is not True:
            raise ResultsUnavailable(reply.reason)
        return True

    def announce(self, fields: Mapping[str, Any]) -> None:
        """Send an event of the panel to all subscribers; without a run there are none."""
        with suppress(RunUnavailable):
            self._call_run("announce", fields)

    def _call_run(
        self, call: str, *arguments: Any, is_withdrawn: Callable[[], bool] = lambda: False
    ) -> Reply:
        """Send a call to the run and wait for its reply, or for its withdrawal."""
        number, reply = self._send(call, *arguments)
        while not is_withdrawn():
            with suppress(TimeoutError):
                return reply.result(_WITHDRAWN_POLL_S)
        self._send("withdraw", number)
        return reply.result()

    def _send(self, call: str, *arguments: Any) -> tuple[int, Future[Reply]]:
        reply: Future[Reply] = Future()
        with self._sending:
            if self._connection is None:
                raise RunUnavailable(NO_RUN)
            number = next(self._numbers)
            if call != "withdraw":  # which has no reply
                self._replies[number] = reply
            line = json.dumps({"id": number, "call": call, "arguments": arguments})
            with suppress(OSError):  # the reading thread finds the lost connection
                self._connection.sendall(line.encode() + b"\n")
        return number, reply

    # The thread that reads.

    def _run(self) -> None:
        while not self._ending.is_set():
            try:
                with (
                    live_address(self._folder) as address,
                    socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection,
                ):
                    connection.connect(address)
                    self._follow(connection)
            except OSError:
                pass  # there is no run, or it has ended
            except Exception:
                _log.exception("the run cannot be followed")
            self._ending.wait(_RECONNECT_S)

    def _follow(self, connection: socket.socket) -> None:
        try:
            with connection.makefile("rb") as lines:
                while (line := lines.readline(_MAX_LINE_BYTES)).endswith(b"\n"):
                    self._handle(json.loads(line), connection)
        finally:
            with self._sending:
                self._connection = None
                unanswered, self._replies = self._replies, {}
            for reply in unanswered.values():
                reply.set_exception(RunUnavailable(f"{NO_RUN}: it ended before its answer"))
            if not self._ending.is_set():
                state_without_parts = replace(self._state, inspected=None, rejected=())
                self.begin(replace(state_without_parts, state=State.PREOPERATIONAL, reason=NO_RUN))

    def _handle(self, line: dict[str, Any], connection: socket.socket) -> None:
        match line:
            case {"snapshot": snapshot}:
                state = STATE.validate_python(snapshot)
                # Before `begin`: a subscriber to the state may send a request at once.
                with self._sending:
                    self._connection = connection
                    if self._ending.is_set():  # `close` found no connection to end
                        connection.shutdown(socket.SHUT_WR)
                self.begin(state)
            case {"reply": fields}:
                reply = Reply.model_validate(fields)
                with self._sending:
                    waiting = self._replies.pop(reply.id)
                waiting.set_result(reply)
            case {"id": position}:
                if position > self._state.event_id:
                    self.add(LiveEvent.of_line(line, self._state))
