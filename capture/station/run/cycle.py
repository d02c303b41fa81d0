"""The cycle of a station: trigger, exposure, verdict, record, announcement.

One thread captures, another judges: the next part is exposed while the last verdict is computed.
"""

import queue
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from capture.station.domain.config import StationConfig
from capture.station.domain.errors import error_text
from capture.station.domain.fault import Fault, fault_of
from capture.station.domain.verdict import Decision
from capture.station.results.database import ResultsUnavailable
from capture.station.results.part_result import PartResult
from capture.station.results.store import BegunPart

from .changeover import Changeover
from .equipment import Equipment, GuardedThread
from .events import (
    Change,
    ExposureComplete,
    PartAnnounced,
    PartBegun,
    RecipeLoaded,
    State,
    StationStopped,
)
from .outcome import ExposedPart
from .self_test import SelfTest, disk_fault
from .triggers import (
    Accepted,
    Asker,
    Beginning,
    PartSensor,
    Refusal,
    Refused,
    Trigger,
    TriggerSource,
    refusal_by,
)

# Interval at which a waiting thread checks whether the station stops.
_POLL_S = 0.2
# Interval of checking whether all parts in progress have their results.
_PAUSE_S = 0.02
# Pause between two attempts to write to a database that does not answer.
_RETRY_S = 0.5
# Time that a result waits for the database after a stop; then the next start makes it an ERROR.
_LAST_WAIT_S = 5.0


class Station:
    """A running station; `run` runs it to its end."""

    def __init__(
        self, folder: Path, config: StationConfig, equipment: Equipment, count: int | None = None
    ) -> None:
        self._folder, self._config = folder, config
        self._rig, self._judge, self._store = equipment.rig, equipment.judge, equipment.store
        self._prepare, self._clock = equipment.prepare, equipment.clock
        self._live, self._sensor = equipment.live, equipment.sensor
        self._report_alive = equipment.report_alive
        self._self_test = SelfTest(self._live.publish)
        self._beginning = Beginning(self._store, self._clock, config.max_trigger_age_s)
        self._stopping = threading.Event()
        self._changeover = Changeover(equipment.recipes, self._live.publish, self._stopping.is_set)
        # Guards everything below; the state changes only while it is held.
        self._lock = threading.RLock()
        self._parts_left = count  # parts that may still be triggered
        self._exposing = False  # from the reservation to the end of the last exposure
        self._waiting = 0  # parts that are exposed and have no announced result
        self._errors = 0  # in a row, of parts or triggers
        self._was_ready = False
        self._error: BaseException | None = None
        self._next: queue.SimpleQueue[tuple[BegunPart, str | None, Trigger]] = queue.SimpleQueue()
        self._exposed: queue.SimpleQueue[ExposedPart | None] = queue.SimpleQueue()

    # For triggers and interfaces.

    @property
    def is_stopping(self) -> bool:
        """Whether no further trigger will be accepted."""
        return self._stopping.is_set()

    def wait_until_ready(self, timeout_s: float) -> bool:
        """Wait until a trigger would be accepted; False after the time-out or a stop."""
        return self._live.wait_for(State.READY, timeout_s) and not self.is_stopping

    def submit(self, trigger: Trigger) -> Accepted | Refused:
        """Accept or refuse a trigger. The part has its row before the answer. Never raises."""
        refused = self._reserve(trigger)
        if refused is not None:
            return self.refuse(trigger, refused)
        try:
            clock_note = self._clock.note_if_set()
            part = self._beginning.begin(trigger, is_simulated=self._rig.is_simulated)
        except BaseException as error:
            fault, kind = fault_of(error), refusal_by(error)
            self._release(None if kind in (Refusal.PART_ID, Refusal.LATE) else fault)
            return self.refuse(trigger, Refused(str(fault), kind))
        self._live.publish(PartBegun(part.part_id, part.number))
        self._next.put((part, clock_note, trigger))
        return Accepted(part.part_id, part.number)

    def load_recipe(self, name: str, by: Asker) -> RecipeLoaded:
        """Load a recipe, and return when it judges all later parts; or raise RecipeRefused."""
        with self._changeover.loading(name, by) as request:
            with self._lock:
                self._changeover.request_exchange(request, self._live.state)
                self._become_free()
            return request.answer.result()

    def resume(self) -> None:
        """Try again after errors in a row, which somebody has acknowledged."""
        with self._lock:
            self._errors = 0
            fault = self._live.state.fault
            if self._live.state.is_stopped_by_errors and fault is not None:
                self._live.change(Change.FAILED, replace(fault, in_a_row=0))

    def stop(self, error: BaseException | None = None) -> None:
        """Accept no further trigger; `run` ends after the parts in progress, with `error`."""
        with self._lock:
            self._error = self._error or error
            self._stopping.set()
            self._changeover.refuse("the station stops")

    # The run.

    def run(self, source: TriggerSource) -> StationStopped:
        """Serve triggers until the source ends, the parts are done, or Ctrl-C, which is raised."""
        workers = (
            GuardedThread(self._capture_parts, self.stop, "station capture"),
            GuardedThread(self._judge_parts, self.stop, "station verdict"),
        )
        triggers = GuardedThread(lambda: source.run(self), self.stop, "triggers", daemon=True)
        self._live.attach(self)
        with self._live.refusals.recording(self._store, lambda: self._rig.is_simulated):
            try:
                for thread in (*workers, triggers):
                    thread.start()
                while not self._stopping.wait(_POLL_S):
                    pass
            except KeyboardInterrupt as interrupt:
                self.stop(interrupt)
            for thread in workers:
                thread.join_through_interrupts()
            # A timer needs this time to record missed periods. A source that waits for a key may
            # never end.
            triggers.join_through_interrupts(2.0 * _POLL_S)
        self._beginning.close()
        reason = "all parts were triggered" if self._parts_left == 0 else "no more triggers come"
        if self._error is not None:
            reason = error_text(self._error)
        with self._lock:
            self._live.change(Change.STOPPED, why=reason)
        state = self._live.state
        stopped = StationStopped(reason, state.announced, state.refused)
        self._live.publish(stopped)
        if self._error is not None:
            raise self._error
        return stopped

    # The thread that captures.

    def _capture_parts(self) -> None:
        try:
            while not self.is_stopping or self._exposing:  # no part begins after a stop
                self._report_alive("capture")
                self._live.wait_for_room(self._stopping.is_set)
                if not self._exposing and not self._is_open():
                    self._become_ready()
                elif self._live.state.state is State.INITIALIZED:
                    self._change_recipe()
                else:
                    if self._sensor is not None and self._live.state.state is State.READY:
                        self._await_part(self._sensor)
                    with suppress(queue.Empty):
                        self._expose(*self._next.get(timeout=_POLL_S))
        finally:
            self._rig.close()
            self._exposed.put(None)

    def _is_open(self) -> bool:
        return self._live.state.state not in (State.PREOPERATIONAL, State.ERROR)

    def _await_part(self, sensor: PartSensor) -> None:
        def is_over() -> bool:
            self._report_alive("capture")
            return self.is_stopping or self._live.state.state is not State.READY

        try:
            sensor.await_part(self, is_over)
        except Exception as error:
            self._fail(fault_of(error))

    def _become_ready(self) -> None:
        """Open the rig and test everything; an error at the start ends the run."""
        self._rig.close()
        if self._waiting > 0 or self._has_lasting_errors:
            self._stopping.wait(_PAUSE_S)
            return
        if self._was_ready and self._stops_within(self._config.reconnect_s):
            return
        try:
            with self._self_test.collecting() as require:
                require(self._prepare())
                self._rig.open()
                with self._lock:
                    self._live.change(Change.OPENED)
                require(self._rig.test(is_start=not self._was_ready))
        except Exception as error:
            self._fail(fault_of(error))
            if not self._was_ready:
                raise
            return
        self._was_ready = True
        with self._lock:
            self._live.change(Change.TESTED)

    def _change_recipe(self) -> None:
        """Exchange the recipe as soon as the last part has its result."""
        with self._lock:
            request = None if self._waiting > 0 else self._changeover.pop_request()
        if request is None:
            self._stopping.wait(_PAUSE_S)
            return
        try:
            self._judge = self._changeover.exchange(request, self._rig, self._self_test)
        except Exception as error:
            self._fail(fault_of(error))
        else:
            with self._lock:
                self._live.change(Change.TESTED)
            request.answer.set_result(request.recipe.loaded_event)

    def _stops_within(self, duration_s: float) -> bool:
        """Wait until the station stops; False if it does not stop in this time."""
        while duration_s > 0.0 and not self._stopping.wait(min(duration_s, _POLL_S)):
            self._report_alive("capture")
            duration_s -= _POLL_S
        return self.is_stopping

    def _expose(self, begun_part: BegunPart, clock_note: str | None, trigger: Trigger) -> None:
        captured, error, exposed_s = None, None, trigger.at_s
        try:
            self._beginning.require_timely(trigger)
            captured, exposed_s = self._rig.capture(begun_part.number)
        except BaseException as raised:
            error = raised
        part = ExposedPart(
            begun=begun_part,
            captured=captured,
            error=error,
            exposed_s=exposed_s,
            exposed_utc=None if captured is None else self._clock.at(exposed_s),
            timings_ms={
                "capture": 1e3 * (exposed_s - trigger.at_s),
                "checks": 1e3 * max(0.0, self._clock.monotonic_s() - exposed_s),
            },
            notes=() if clock_note is None else (clock_note,),
        )
        with self._lock:
            self._exposing = False
            self._waiting += 1
            if self._parts_left == 0:
                self.stop()
            self._exposed.put(part)
            self._live.publish(ExposureComplete(begun_part.part_id, begun_part.number))
            if part.rig_fault is None:
                self._become_free()
            else:
                self._fail(part.rig_fault)
        if not isinstance(error, Exception | None):
            self.stop(error)

    # The thread that judges.

    def _judge_parts(self) -> None:
        with ThreadPoolExecutor(1, "station writer") as writer:
            while (part := self._next_exposed()) is not None:
                judged, fault, error = self._judge.result_of(part, writer)
                result = self._add(judged)
                latency_ms = 1e3 * (self._clock.monotonic_s() - part.exposed_s)
                self._live.publish(PartAnnounced(result, latency_ms, fault))
                with self._lock:
                    self._waiting -= 1
                    self._become_free()
                    if result.verdict.decision is not Decision.ERROR:
                        self._errors = 0
                    elif fault is not None:
                        self._count_error(fault, fails=fault.device == "disk")
                if not isinstance(error, Exception | None):
                    self.stop(error)

    def _next_exposed(self) -> ExposedPart | None:
        """Wait for an exposed part; None if no further one comes."""
        while True:
            self._report_alive("verdict")
            with suppress(queue.Empty):
                return self._exposed.get(timeout=_POLL_S)

    def _add(self, result: PartResult) -> PartResult:
        """Write a row; wait until the database answers."""
        deadline_s = None
        while True:
            try:
                return self._store.add(result)
            except ResultsUnavailable as error:
                self._fail(fault_of(error))
                if self.is_stopping:
                    now_s = self._clock.monotonic_s()
                    deadline_s = deadline_s or now_s + _LAST_WAIT_S
                    if now_s > deadline_s:
                        raise
            self._report_alive("verdict")
            time.sleep(_RETRY_S)

    # State and reservations.

    def _reserve(self, trigger: Trigger) -> Refused | None:
        """Reserve the rig for a part; return the refusal if that is not possible."""
        with self._lock:
            if self.is_stopping or self._parts_left == 0:
                return Refused("the station is stopping", Refusal.STOPPING)
            if self._exposing:
                return Refused("busy: another part is being exposed", Refusal.BUSY)
            if not self._is_open():
                return Refused(f"not ready: {self._live.state.reason}")
            if self._waiting >= self._config.buffers:
                return Refused(f"busy: {self._waiting} parts wait for their verdict", Refusal.BUSY)
            if self._live.state.state is not State.READY:
                if self._changeover.is_requested:
                    return Refused("not ready: a recipe waits for the parts in progress")
                return Refused("not ready: the self-test runs")
            if self._changeover.lacks(trigger.recipe):
                return Refused(f"recipe {trigger.recipe} is not the loaded one", Refusal.RECIPE)
            sets_bytes = (self._waiting + 1) * self._rig.set_bytes
            fault = disk_fault(self._folder, self._config.disk_floor_mb, sets_bytes)
            if fault is not None:
                self._count_error(fault)
                return Refused(str(fault), Refusal.DISK)
            self._exposing = True
            self._live.change(Change.TRIGGERED)
            if self._parts_left is not None:
                self._parts_left -= 1
            return None

    def _release(self, failure: Fault | None) -> None:
        """Undo `_reserve` for a part that was not begun; count its `failure`, if any."""
        with self._lock:
            self._exposing = False
            if self._parts_left is not None:
                self._parts_left += 1
            if failure is None:
                self._become_free()
            else:
                self._count_error(failure)

    def refuse(self, trigger: Trigger, refused: Refused) -> Refused:
        """Record a trigger that cannot be served, as soon as the database answers. Never raises."""
        self._live.refusals.add(trigger, refused.reason)
        return refused

    def _become_free(self) -> None:
        """Allow a change of recipe, or the next trigger, if the camera is free."""
        with self._lock:
            state, has_buffer = self._live.state.state, self._waiting < self._config.buffers
            if self._exposing or state not in (State.READY, State.EXECUTING):
                return
            if self._changeover.is_requested:
                self._live.change(Change.RECIPE)
            elif has_buffer and state is State.EXECUTING and not self.is_stopping:
                self._live.change(Change.FREE)

    @property
    def _has_lasting_errors(self) -> bool:
        """Whether there were so many errors in a row that somebody must acknowledge them."""
        return self._errors >= self._config.stop_after_errors

    def _count_error(self, fault: Fault, *, fails: bool = True) -> None:
        """Count an error; the station fails if `fails`, or after too many errors in a row."""
        self._errors += 1
        if self._has_lasting_errors:
            fault = replace(fault, in_a_row=self._errors)
        if fails or self._has_lasting_errors:
            self._fail(fault)

    def _fail(self, fault: Fault) -> None:
        with self._lock:
            self._live.change(Change.FAILED, fault)
            self._changeover.refuse(f"not ready: {fault}")
