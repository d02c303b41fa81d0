"""`Verdict`: the decision of the station on a part, and its reason."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Self


class Decision(StrEnum):
    """The four verdicts. Only PASS goes on; the other three go to the reject bin."""

    PASS = "PASS"
    FAIL = "FAIL"
    UNKNOWN = "UNKNOWN"
    ERROR = "ERROR"


# Codes of causes for a PLC, by verdict, the gravest first.
_CODES = {
    Decision.ERROR: range(1, 20),
    Decision.UNKNOWN: range(20, 40),
    Decision.FAIL: range(40, 256),
}


class Cause(StrEnum):
    """Why a part did not pass, the gravest first.

    A row has the name, the verdict, the code for a PLC, which is never reused, and the meaning.
    """

    decision: Decision
    plc_code: int
    meaning: str
    gravity: int  # 0 is the gravest

    CAPTURE = (
        "capture",
        Decision.ERROR,
        1,
        "the set was rejected; the trigger was too old",
    )
    RIG = "rig", Decision.ERROR, 2, "camera or lights failed, or an LED is weak"
    CALIBRATION = "calibration", Decision.ERROR, 3, "missing, too old, or of another rig or setting"
    INTERRUPTED = "interrupted", Decision.ERROR, 4, "the station ended before the verdict"
    STORAGE = "storage", Decision.ERROR, 5, "the set could not be written"
    UNFORESEEN = "unforeseen", Decision.ERROR, 6, "a value is missing, or the program has a fault"

    NO_TEXTURE = "no-texture", Decision.UNKNOWN, 20, "beyond the limit of every texture"
    UNDECIDED = "undecided", Decision.UNKNOWN, 21, "small margin, or the orientation is not clear"
    BLUR = "blur", Decision.UNKNOWN, 22, "out of focus"
    COLLECTED = "collected", Decision.UNKNOWN, 23, "collected to be taught, not judged"

    BAD_TEXTURE = "bad-texture", Decision.FAIL, 40, "a texture that the recipe rejects"
    WRONG_TEXTURE = "wrong-texture", Decision.FAIL, 41, "a texture that the recipe does not name"
    ORIENTATION = "orientation", Decision.FAIL, 42, "the part lies otherwise than it must"
    ROUGHNESS = "roughness", Decision.FAIL, 43, "Sdq outside its limits"
    SHADOW = "shadow", Decision.FAIL, 44, "too many pixels that a light does not reach"
    DEFECT = "defect", Decision.FAIL, 45, "a defect, or an area that the defect map cannot judge"
    ALBEDO = "albedo", Decision.FAIL, 46, "darker or brighter than the taught parts"
    SCALE = "scale", Decision.FAIL, 47, "the texture is larger or smaller"
    HANDEDNESS = "handedness", Decision.FAIL, 48, "mirrored"
    OCTAVES = "octaves", Decision.FAIL, 49, "relief or contrast of an octave is not as taught"
    SEAM = "seam", Decision.FAIL, 50, "a window whose directions differ from those of good parts"
    WINDOW = "window", Decision.FAIL, 51, "a window that looks like no good one"

    def __new__(cls, name: str, decision: Decision, plc_code: int, meaning: str) -> Self:
        """Make a cause, after a check of its row against those above it."""
        cause = str.__new__(cls, name)
        cause._value_ = name
        cause.decision, cause.plc_code, cause.meaning = decision, plc_code, meaning
        graver = [*cls.__members__.values()]
        cause.gravity = len(graver)
        if not _CODES[decision].start <= plc_code < _CODES[decision].stop:
            raise ValueError(f"{name}: code {plc_code} of a {decision}: one of {_CODES[decision]}")
        if any(plc_code == other.plc_code for other in graver):
            raise ValueError(f"{name}: code {plc_code} is in use")
        if graver and _CODES[graver[-1].decision].start > plc_code:
            raise ValueError(f"{name}: {decision} is graver than {graver[-1]}, in the row above")
        return cause

    @classmethod
    def named(cls, name: str) -> Self:
        """Return the cause with this name."""
        return cls(name)  # type: ignore[call-arg]  # a look-up, not a row


@dataclass(frozen=True)
class Verdict:
    """The verdict on a part; ValueError for a PASS with causes, or another decision without one."""

    decision: Decision
    reason: str  # in one sentence, with the values and their limits
    causes: tuple[Cause, ...] = ()  # of all findings, the gravest first; empty for PASS

    def __post_init__(self) -> None:
        if (self.decision is Decision.PASS) == bool(self.causes):
            raise ValueError(f"{self.decision} with causes {list(self.causes)}")
