"""`Fault`: why a station or a part failed, as a value made where the error is caught."""

from dataclasses import dataclass

from capture.base.errors import CalibrationError, SetRejected
from rig import HardwareError

from .errors import error_text
from .verdict import Cause, Decision, Verdict

_CAUSES = (
    (SetRejected, Cause.CAPTURE),
    (CalibrationError, Cause.CALIBRATION),
    (HardwareError, Cause.RIG),
)


@dataclass(frozen=True)
class Fault:
    """A failure with its cause and device; its text is the sentence for people."""

    cause: Cause
    detail: str
    # ``camera``, ``lights``, ``rig`` for either, ``disk`` or ``database``; empty: of no device.
    device: str = ""
    measured: float | None = None
    limit: float | None = None
    in_a_row: int = 0  # errors in a row, where they stop the line

    @property
    def verdict(self) -> Verdict:
        """The verdict on a part that has the fault."""
        return Verdict(Decision.ERROR, self.detail, (self.cause,))

    def __str__(self) -> str:
        if not self.in_a_row:
            return self.detail
        return (
            f"{self.detail}; {self.in_a_row} errors in a row (stop_after_errors): acknowledge "
            "them, or start the station again"
        )


def fault_of(error: BaseException, cause: Cause | None = None) -> Fault:
    """Return the fault behind an error; without a `cause`, the kind of error determines it."""
    cause = cause or getattr(error, "cause", None)
    if cause is None:
        cause = next((row for kind, row in _CAUSES if isinstance(error, kind)), Cause.UNFORESEEN)
    device = getattr(error, "device", "disk" if cause is Cause.STORAGE else "")
    return Fault(cause, error_text(error), device)
