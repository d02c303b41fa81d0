"""The comparison of a rig with its calibration at the start of a session."""

from capture.calibration.ps4cal import CalibrationFile
from capture.procedures.rig_check import checks_of_drift, drift_of_rig, lays_sheet_down
from classify.base.errors import CalibrationRejected
from rig import Rig
from rig.doctor.check import Check

from .events import Answer, Ask, PlaceSheet, Publish, RigCompared

_NOT_COMPARED = Check(
    "sheet",
    "unknown",
    "the rig was not compared with it",
    "run ps4rig rig doctor --sheet with a white sheet below the camera",
)


def compare_rig(rig: Rig, known: CalibrationFile, ask: Ask, publish: Publish) -> Answer:
    """Compare a rig with its calibration by a white sheet, and publish the result.

    Return GO, or STOP if the person stops before the first comparison; raise CalibrationRejected on
    a fault.
    """
    cause: str | None = None
    is_alone = lays_sheet_down(rig)
    while True:
        answer = Answer.GO if is_alone else ask(PlaceSheet(cause))
        if answer is Answer.SKIP:
            publish(RigCompared((_NOT_COMPARED,)))
            return Answer.GO
        if answer is Answer.STOP:
            if cause is None:
                return Answer.STOP
            raise CalibrationRejected(cause)
        try:
            checks = tuple(checks_of_drift(drift_of_rig(rig, known)))
        except CalibrationRejected as error:
            cause = str(error)
        else:
            faults = [f"{each.seen}: {each.advice}" for each in checks if each.status == "fault"]
            if not faults:
                publish(RigCompared(checks))
                return Answer.GO
            cause = "; ".join(faults)
        if is_alone:
            raise CalibrationRejected(cause)
