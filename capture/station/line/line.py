"""`PlcLine`: connects a `Handshake` with a running station, for any bus."""

import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import Self

from capture.station.run.events import Device
from capture.station.run.live_station import LiveStation
from capture.station.run.live_view import LiveEvent
from capture.station.run.triggers import RecipeRefusal, RecipeRefused, Trigger

from .handshake import ASKER, SOURCE, Handshake, RecipeRequest, TriggerRequest

_log = logging.getLogger(__name__)
# Time for which the last results wait for the PLC: many scans of its program.
_LAST_S = 3.0
# Period of the station's heartbeat.
TICK_S = 0.5
# Time after which an unchanged heartbeat is a fault: four times the period that the README requires
# of a PLC.
_SILENCE_S = 8.0


class PlcLine:
    """A thread-safe handshake, and a thread that passes its triggers to the station.

    Its context ends when the PLC has acknowledged all results, or after `last_s`.
    """

    def __init__(
        self,
        live: LiveStation,
        handshake: Handshake,
        now_s: Callable[[], float] = time.monotonic,
        last_s: float = _LAST_S,
    ) -> None:
        self._live, self._handshake, self._now_s = live, handshake, now_s
        self._last_s = last_s
        self._changed = threading.Condition()
        self._request: TriggerRequest | None = None
        self._is_closed = False
        self._heard_s = now_s()
        self._thread = threading.Thread(target=self._run, name="triggers of the PLC")
        self._loading: RecipeRequest | None = None
        self._loader: threading.Thread | None = None

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._changed.wait_for(self._is_done, self._last_s)
            self._is_closed = True
            self._changed.notify_all()
            loader = self._loader
        self._thread.join()
        if loader is not None:
            # It ends soon: a station that stops refuses a recipe that waits or is being loaded.
            loader.join()

    # The bus.

    def tell(self, live: LiveEvent) -> None:
        """Handle an event of the station."""
        with self._changed:
            self._handshake.tell(live)
            self._changed.notify_all()

    def station_words(self) -> list[int]:
        """Return the registers that the station shows, of one moment."""
        with self._changed:
            return self._handshake.station_words()

    def plc_words(self) -> list[int]:
        """Return the registers that the PLC writes."""
        with self._changed:
            return self._handshake.plc_words()

    def write(self, address: int, words: Sequence[int]) -> None:
        """Handle a write of the PLC."""
        with self._changed:
            before = self._handshake.commands["heartbeat"]
            request = self._handshake.write(address, words)
            if self._handshake.commands["heartbeat"] != before:
                self._heard_s = self._now_s()
            if request is not None and request.refusal is not None:
                self._live.refusals.add(Trigger(SOURCE, request.part_id), request.refusal)
            elif request is not None:
                self._request = request
            self._start_loading(self._handshake.selection.loading)
            self._changed.notify_all()

    def tick(self, connections: int, where: str) -> None:
        """Increment the heartbeat and show the state of the PLC; call it every `TICK_S`."""
        with self._changed:
            self._handshake.heartbeat += 1
            heartbeat = self._handshake.commands["heartbeat"]
            is_silent = heartbeat != 0 and self._now_s() - self._heard_s > _SILENCE_S
        self._live.show_device(_device(connections, heartbeat, where, is_silent=is_silent))

    def _is_done(self) -> bool:
        return not self._handshake.is_busy and not self._handshake.has_results

    # The thread.

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._is_closed or self._request is not None)
                is_closed = self._is_closed
                request, self._request = self._request, None
            if request is not None:
                answer = self._live.submit(Trigger(SOURCE, request.part_id, request.recipe))
                with self._changed:
                    self._handshake.handle_answer(request, answer)
                    self._changed.notify_all()
            if is_closed:
                return

    def _start_loading(self, request: RecipeRequest | None) -> None:
        """Load a recipe in a thread of its own: triggers and their refusals must not wait."""
        if request is None or request is self._loading:
            return
        self._loading = request
        self._loader = threading.Thread(
            target=self._load_recipe, args=(request,), name="recipe of the PLC"
        )
        self._loader.start()

    def _load_recipe(self, request: RecipeRequest) -> None:
        try:
            self._live.load_recipe(request.name, ASKER)
        except Exception as error:
            kind = RecipeRefusal.UNFORESEEN
            if isinstance(error, RecipeRefused):
                kind = error.kind
            else:
                _log.exception("recipe %s was not loaded for the PLC", request.name)
            with self._changed:
                self._handshake.selection.handle_refusal(request, kind)


def _device(connections: int, heartbeat: int, where: str, *, is_silent: bool) -> Device:
    if connections == 0:
        return Device("plc", "warning", f"no PLC is connected to {where}")
    if is_silent:
        return Device("plc", "fault", f"the heartbeat of the PLC stays at {heartbeat}")
    return Device("plc", "ok", "connected" if heartbeat else "connected, without a heartbeat")
