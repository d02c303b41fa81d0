"""`Verdict`: the decision of the station on a part, and its reason."""

from dataclasses import dataclass
from enum import StrEnum


class Decision(StrEnum):
    """The four verdicts. Only PASS goes on; the other three go to the reject bin."""

    PASS = "PASS"
    FAIL = "FAIL"
    UNKNOWN = "UNKNOWN"
    ERROR = "ERROR"


class Cause(StrEnum):
    """Why a part did not pass, as a code: causes of ERROR, then of UNKNOWN, then of FAIL."""

    CAPTURE = "capture"  # the set was rejected: saturation, a dead LED, stale frames
    RIG = "rig"  # camera or lights failed
    CALIBRATION = "calibration"  # missing, too old, or of another rig or setting
    INTERRUPTED = "interrupted"  # the station ended before the verdict
    STORAGE = "storage"  # the set could not be written
    UNFORESEEN = "unforeseen"  # anything else

    NO_TEXTURE = "no-texture"  # beyond the limit of every class
    UNDECIDED = "undecided"  # two classes are about as near, or the orientation is not clear
    BLUR = "blur"  # out of focus

    BAD_TEXTURE = "bad-texture"  # a class that the recipe rejects
    WRONG_TEXTURE = "wrong-texture"  # a class that the recipe does not name
    ORIENTATION = "orientation"
    ROUGHNESS = "roughness"  # Sdq outside its limits
    SHADOW = "shadow"  # shadow fraction outside its limits
    DEFECT = "defect"
    ALBEDO = "albedo"  # darker or brighter than the taught parts
    SCALE = "scale"  # the texture is larger or smaller
    HANDEDNESS = "handedness"  # mirrored
    OCTAVES = "octaves"  # the relief or the contrast of an octave is stronger or weaker
    SEAM = "seam"  # directions of a window
    WINDOW = "window"  # a window unlike all good ones


@dataclass(frozen=True)
class Verdict:
    """The verdict on a part; ValueError for a PASS with causes, or another decision without one."""

    decision: Decision
    reason: str  # in one sentence, with the values and their limits
    causes: tuple[Cause, ...] = ()  # of all findings, the gravest first; empty for PASS

    def __post_init__(self) -> None:
        if (self.decision is Decision.PASS) == bool(self.causes):
            raise ValueError(f"{self.decision} with causes {list(self.causes)}")
