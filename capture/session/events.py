"""Events of a session for its subscribers, and questions to the operator."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum

from rig import Rig
from rig.doctor.check import Check

from .journal import FinishReason, SetEntry
from .plan import PlannedSet


@dataclass(frozen=True)
class SetCaptured:
    """A set was captured and is in its file and in the journal."""

    entry: SetEntry


@dataclass(frozen=True)
class SetFailed:
    """A set could not be captured."""

    planned: PlannedSet
    reason: str


@dataclass(frozen=True)
class SetAdopted:
    """The file of an earlier run, which was killed before its entry, is in the journal now."""

    entry: SetEntry


@dataclass(frozen=True)
class SetDamaged:
    """The damaged file of a captured set was set aside: the set is missing again."""

    planned: PlannedSet
    reason: str


@dataclass(frozen=True)
class RigCompared:
    """Checks of the rig against its calibration.

    If the rig was not compared, there is one check, of status ``unknown``.
    """

    checks: tuple[Check, ...]


@dataclass(frozen=True)
class RigChanged:
    """The settings of the rig differ from those of the last run; one line for each difference."""

    changes: tuple[str, ...]


@dataclass(frozen=True)
class SessionFinished:
    """The run is over."""

    finish: FinishReason
    reason: str | None
    captured: int
    missing: int
    left_out: int


Event = (
    SetCaptured | SetFailed | SetAdopted | SetDamaged | RigCompared | RigChanged | SessionFinished
)
Publish = Callable[[Event], None]


class Answer(StrEnum):
    """A decision of the operator."""

    GO = "go"
    REPEAT = "repeat"
    SKIP = "skip"
    LEAVE = "leave"  # go on; the set stays missing
    STOP = "stop"


@dataclass(frozen=True)
class PlaceSpecimen:
    """Put the specimen below the camera; REPEAT captures the previous placement once more."""

    planned: PlannedSet
    # Returns the rig for live images until the answer, and opens it if necessary.
    live_rig: Callable[[], Rig] | None = field(default=None, compare=False)


@dataclass(frozen=True)
class PlaceSheet:
    """Put a white matt sheet below the camera; SKIP leaves the comparison out."""

    cause: str | None  # why the calibration did not hold at the previous try, None at the first one


@dataclass(frozen=True)
class DecideFailure:
    """A set failed; REPEAT tries once more. `lost_rig` if camera or lights failed."""

    planned: PlannedSet
    reason: str
    lost_rig: bool


@dataclass(frozen=True)
class DecideWarnings:
    """A set has `warnings`; GO keeps it."""

    planned: PlannedSet
    warnings: tuple[str, ...]


Question = PlaceSpecimen | PlaceSheet | DecideFailure | DecideWarnings
Ask = Callable[[Question], Answer]


def without_questions(question: Question) -> Answer:
    """Answer without an operator.

    Sets are kept, failed ones stay missing, and without a rig the session stops. The comparison is
    skipped, because somebody must put the sheet in place.
    """
    if isinstance(question, DecideFailure):
        return Answer.STOP if question.lost_rig else Answer.LEAVE
    if isinstance(question, PlaceSheet):
        return Answer.SKIP
    return Answer.GO
