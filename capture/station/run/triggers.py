"""Triggers, their sources, and the recording of triggered parts."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Annotated, NamedTuple, Self

from pydantic import Field

from capture.base.errors import SetRejected
from capture.station.domain.errors import Conflict
from capture.station.results.database import ResultsUnavailable, safe_url
from capture.station.results.store import BegunPart, ResultStore
from classify.base.errors import InputError

from .station_clock import StationClock
from .station_rig import StationRig

if TYPE_CHECKING:
    from .cycle import Station

# Interval at which a waiting source checks whether the station stops.
_POLL_S = 0.2
_SENSOR = "sensor"
_MISSED = "passed the sensor while the station was busy or not ready"
# Largest number of missed parts with a row each; one row counts the others. A sensor that counts
# more between two waits is faulty.
MAX_RECORDED = 20


class Asker(NamedTuple):
    """The person or program that requests a recipe; a role is one such as ``engineer``."""

    name: str
    role: str
    shown_sha256: str | None = None  # hash of the recipe that the asker was shown, if any
    via: str = "PLC"


class _Code(IntEnum):
    """A number that the PLC reads, with its meaning for the reference."""

    meaning: str

    def __new__(cls, value: int, meaning: str) -> Self:
        """Create a code of that value, with its meaning."""
        code = int.__new__(cls, value)
        code._value_, code.meaning = value, meaning
        return code


class RecipeRefusal(_Code):
    """Why a recipe is not loaded."""

    NOT_READY = 1, "the station starts, stops, is in error, or collects parts to teach"
    BUSY = 2, "another recipe is being loaded"
    UNKNOWN = 3, "no recipe has this position in `recipes`, or its file is missing"
    NOT_APPROVED = 4, "nobody approved it as it is"
    CHALLENGE = 5, "it does not meet its challenge set"
    UNUSABLE = 6, "it was not taught, is damaged, or has no challenge set or calibration"
    RIG = 7, "the self-test with its light found a fault"
    DATABASE = 8, "the change could not be recorded"
    UNFORESEEN = 9, "the program has a fault"


class RecipeRefused(Conflict):
    """A recipe is not loaded; the station goes on with the present one."""

    def __init__(self, reason: str, kind: RecipeRefusal) -> None:
        super().__init__(reason)
        self.kind = kind


@dataclass(frozen=True)
class Trigger:
    """A part lies below the camera."""

    source: str  # ``timer``, ``enter``, ``sensor``, ``http`` or ``modbus``
    part_id: str | None = None  # unique in the station; None lets the station generate one
    recipe: str | None = None  # recipe that must judge the part; None for any
    at_s: float = field(default_factory=time.monotonic, compare=False)
    # Whether the client has gone before the answer; not part of a request over a socket.
    is_withdrawn: Annotated[Callable[[], bool], Field(exclude=True)] = field(
        default=lambda: False, compare=False
    )


class TriggerTooLate(SetRejected):
    """Another part may be below the camera by now, or nobody waits for the answer."""


@dataclass(frozen=True)
class Accepted:
    """The part has its row in the results, and its exposure begins."""

    part_id: str
    number: int


class Refusal(_Code):
    """Why a trigger was refused; 10 to 12, 14 and 15 are reasons of the handshake with a PLC."""

    BUSY = 1, "another part is exposed, or parts wait for their verdicts"
    NOT_READY = 2, "the station is not ready; `state` says more"
    STOPPING = 3, "the station stops"
    DISK = 4, "the disk is at its floor"
    DATABASE = 5, "the database of results does not answer"
    PART_ID = 6, "`part_id` is invalid, or was used before"
    UNFORESEEN = 7, "the program has a fault"
    TRIGGER_ID = 10, "`trigger_id` is 0, or that of the last trigger"
    UNANSWERED = 11, "an earlier trigger is not answered yet"
    RESULTS_WAITING = 12, "16 results are not acknowledged"
    RECIPE = 13, "the loaded recipe is not the required one"
    OTHER_TRIGGER = 14, 'parts are triggered otherwise: `trigger` is not "modbus"'
    RECIPE_LOADING = 15, "a recipe that the PLC selected is being loaded"
    LATE = 16, "the trigger was older than `max_trigger_age_s`"


def refusal_by(error: BaseException) -> Refusal:
    """Return the code for an error that was raised before the part was accepted."""
    if isinstance(error, InputError):
        return Refusal.PART_ID
    if isinstance(error, TriggerTooLate):
        return Refusal.LATE
    return Refusal.DATABASE if isinstance(error, ResultsUnavailable) else Refusal.UNFORESEEN


@dataclass(frozen=True)
class Refused:
    """The trigger is not served, because of `reason`; nothing is exposed."""

    reason: str
    kind: Refusal = Refusal.NOT_READY


Answer = Accepted | Refused


class TimerTrigger:
    """A trigger in each period, or whenever the station is ready if the period is 0.

    Triggers that are late by a period or more are refused; one row counts them.
    """

    def __init__(self, period_s: float, now_s: Callable[[], float] = time.monotonic) -> None:
        self._period_s = period_s
        self._now_s = now_s

    def run(self, station: "Station") -> None:
        """Submit triggers until the station stops."""
        station_was_ready, missed = False, 0
        next_s = self._now_s()
        while not station.is_stopping:
            # The first trigger waits for the self-test; with a period of 0 each one waits.
            if self._period_s == 0.0 or not station_was_ready:
                station_was_ready = station.wait_until_ready(_POLL_S)
                next_s = self._now_s()
                if not station_was_ready:
                    continue
            late_s = self._now_s() - next_s
            if late_s < 0.0:
                time.sleep(min(-late_s, _POLL_S))
                continue
            if periods := self._missed(late_s):
                missed += periods
                next_s += periods * self._period_s
                continue
            station.submit(Trigger("timer"))
            next_s += self._period_s
            # After the submission, because a slow refusal would make this trigger late as well.
            _refuse_missed(station, missed)
            missed = 0
        _refuse_missed(station, missed + self._missed(self._now_s() - next_s))

    def _missed(self, late_s: float) -> int:
        """Return the number of triggers due by now; 0 if the first is less than a period late."""
        return int(late_s / self._period_s) + 1 if 0.0 < self._period_s <= late_s else 0


def _refuse_missed(station: "Station", missed: int) -> None:
    if missed > 0:
        late = Refused(f"late: {missed} periods of the timer have passed")
        station.refuse(Trigger("timer"), late)


class NoTriggers:
    """Triggers come from interfaces only."""

    def run(self, station: "Station") -> None:
        """Wait until the station stops."""
        while not station.is_stopping:
            time.sleep(_POLL_S)


class SensorTrigger(NoTriggers):
    """The part sensor at the light controller; the cycle itself waits for it."""


class LineTrigger:
    """A trigger for each line of input, the part's id; ``q`` or the end of the input ends it."""

    def __init__(self, read_line: Callable[[], str]) -> None:
        self._read_line = read_line

    def run(self, station: "Station") -> None:
        """Submit a trigger for each line."""
        while not station.is_stopping:
            line = self._read_line()
            text = line.strip()
            if not line or text == "q":
                return
            station.submit(Trigger("enter", text or None))


TriggerSource = TimerTrigger | NoTriggers | LineTrigger
"""Submits triggers until the station stops."""


class PartSensor:
    """The sensor at the light controller of a rig; each part that it sees is a trigger."""

    def __init__(self, rig: StationRig, store: ResultStore) -> None:
        self._rig, self._store = rig, store

    def await_part(self, station: "Station", is_over: Callable[[], bool]) -> None:
        """Wait for a part and submit its trigger, unless `is_over`.

        Missed parts are refused, up to `MAX_RECORDED` of them with a row each.
        """
        missed = self._rig.missed_parts()
        for _ in range(min(missed, MAX_RECORDED)):
            if is_over():  # each row may wait for a locked database
                break
            station.refuse(Trigger(_SENSOR), Refused(f"the part {_MISSED}"))
            missed -= 1
        if missed > 0:
            station.refuse(Trigger(_SENSOR), Refused(f"parts that {_MISSED}: {missed}"))
        part_came = self._rig.wait_for_part(self._store.last_number() + 1, is_over)
        if part_came and isinstance(station.submit(Trigger(_SENSOR)), Refused):
            self._rig.forget_part()


class Beginning:
    """Records triggered parts in a thread of its own; a caller waits at most `max_age_s` for it."""

    def __init__(self, store: ResultStore, clock: StationClock, max_age_s: float) -> None:
        self._store, self._clock, self._max_age_s = store, clock, max_age_s
        self._writer = ThreadPoolExecutor(1, "station trigger")

    def close(self) -> None:
        """Begin no further part; do not wait for a locked database."""
        self._writer.shutdown(wait=False, cancel_futures=True)

    def require_timely(self, trigger: Trigger) -> None:
        """Raise TriggerTooLate if another part may lie below the camera by now."""
        age_s = self._clock.monotonic_s() - trigger.at_s
        if age_s > self._max_age_s:
            raise TriggerTooLate(
                f"late: the trigger is {age_s:.2f} s old, max_trigger_age_s is {self._max_age_s:g}"
            )

    def begin(self, trigger: Trigger, *, is_simulated: bool) -> BegunPart:
        """Record a part, if its client still waits.

        If the row is written after this raised `ResultsUnavailable`, the next self-test makes the
        part an ERROR.
        """

        def require_awaited() -> None:
            self.require_timely(trigger)
            if trigger.is_withdrawn():
                raise TriggerTooLate("its client is gone")

        require_awaited()
        part = self._writer.submit(
            self._store.begin,
            trigger=trigger.source,
            triggered_utc=self._clock.now(),
            simulated=is_simulated,
            part_id=trigger.part_id,
            require=require_awaited,
        )
        try:
            return part.result(self._max_age_s)
        except TimeoutError as error:
            part.cancel()
            text = f"{safe_url(self._store.url)}: no answer in {self._max_age_s:g} s"
            raise ResultsUnavailable(text) from error
