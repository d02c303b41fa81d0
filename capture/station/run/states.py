"""States of a station, with the names of OPC 40100-1, and their transitions."""

import threading
from collections.abc import Callable
from enum import StrEnum


class State(StrEnum):
    """What the station can do at present."""

    PREOPERATIONAL = "preoperational"  # starting, or ended: no rig, no recipe
    INITIALIZED = "initialized"  # recipe loaded, rig open; the self-test runs
    READY = "ready"  # the next trigger is accepted
    EXECUTING = "executing"  # a part is exposed, or no buffer is free
    ERROR = "error"  # rig, disk or database failed; the station tries again


class Change(StrEnum):
    """Why a station changes its state."""

    OPENED = "recipe loaded and rig open"
    TESTED = "self-test passed"
    TRIGGERED = "trigger accepted"
    FREE = "exposure complete and a buffer free"
    RECIPE = "another recipe is wanted, and no part is exposed"
    FAILED = "rig, disk, database or self-test failed"
    STOPPED = "stopped"


TRANSITIONS: dict[tuple[State, Change], State] = {
    (State.PREOPERATIONAL, Change.OPENED): State.INITIALIZED,
    (State.PREOPERATIONAL, Change.FAILED): State.ERROR,
    (State.INITIALIZED, Change.TESTED): State.READY,
    (State.INITIALIZED, Change.FAILED): State.ERROR,
    (State.READY, Change.TRIGGERED): State.EXECUTING,
    (State.READY, Change.RECIPE): State.INITIALIZED,
    (State.READY, Change.FAILED): State.ERROR,
    (State.EXECUTING, Change.FREE): State.READY,
    (State.EXECUTING, Change.RECIPE): State.INITIALIZED,
    (State.EXECUTING, Change.FAILED): State.ERROR,
    (State.ERROR, Change.OPENED): State.INITIALIZED,
    (State.ERROR, Change.FAILED): State.ERROR,
    **{(state, Change.STOPPED): State.PREOPERATIONAL for state in State},
}
"""Every transition that is allowed; any other is a defect of the program."""


class ErrorRow:
    """Errors in a row, of parts or triggers; too many are a fault that the self-test misses."""

    def __init__(self, limit: int) -> None:
        self._limit, self._count = limit, 0

    @property
    def is_full(self) -> bool:
        """Whether the line stands until somebody ends the row."""
        return self._count >= self._limit

    def add(self, reason: str) -> str:
        """Count an error; return its reason, with the way out if the row is full."""
        self._count += 1
        if not self.is_full:
            return reason
        return (
            f"{reason}; {self._count} errors in a row (stop_after_errors): acknowledge a rejected "
            "part, or start the station again"
        )

    def end(self) -> None:
        """Begin a new row: a part was judged, or somebody has seen the errors."""
        self._count = 0


class StateMachine:
    """The state of a station, thread-safe; `changed` is called after each change, in order."""

    def __init__(self, changed: Callable[[State, str], None]) -> None:
        self._state = State.PREOPERATIONAL
        self._changed = changed
        self._condition = threading.Condition(threading.RLock())

    @property
    def state(self) -> State:
        """The present state."""
        return self._state

    def change(self, change: Change, reason: str = "", *, is_news: bool = False) -> State:
        """Make a transition and return the new state; ValueError if the table does not have it.

        A state that stays is told again if `is_news`.
        """
        with self._condition:
            new = TRANSITIONS.get((self._state, change))
            if new is None:
                raise ValueError(f"a station that is {self._state} cannot change by: {change}")
            if new is not self._state or is_news:
                self._state = new
                self._changed(new, reason or change)
                self._condition.notify_all()
            return new

    def wait_for(self, *states: State, timeout_s: float) -> bool:
        """Wait until the state is one of `states`; False after the time-out."""
        with self._condition:
            return self._condition.wait_for(lambda: self._state in states, timeout_s)
