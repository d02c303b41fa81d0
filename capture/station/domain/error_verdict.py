"""The verdict ERROR on a part from an exception."""

from capture.base.errors import CalibrationError, SetRejected
from rig import HardwareError

from .errors import error_text
from .verdict import Cause, Decision, Verdict

_CAUSES = (
    (SetRejected, Cause.CAPTURE),
    (CalibrationError, Cause.CALIBRATION),
    (HardwareError, Cause.RIG),
)
_OTHERWISE = Cause.UNFORESEEN


def error_verdict(error: BaseException, cause: Cause | None = None) -> Verdict:
    """Return the verdict ERROR on a part; a `cause` of None is derived from the kind of error."""
    if cause is None:
        cause = next((known for kind, known in _CAUSES if isinstance(error, kind)), _OTHERWISE)
    return Verdict(Decision.ERROR, error_text(error), (cause,))
