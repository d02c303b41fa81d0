"""States of a station, with the names of OPC 40100-1, and their transitions."""

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
    RECIPE = "another recipe is requested, and no part is exposed"
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
