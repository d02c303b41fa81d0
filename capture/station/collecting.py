"""`Collector`: in place of an `Inspector` while parts are captured that are to be taught."""

from capture.sets.captured_set import CapturedSet

from .inspector import Inspection
from .verdict import Cause, Decision, Verdict

COLLECTS = "this run judges no part: it collects parts that are to be taught"


class Collector:
    """Says UNKNOWN of every part: no part of such a run may pass."""

    def inspect(self, captured: CapturedSet) -> Inspection:  # noqa: ARG002 - as an inspector
        """Judge nothing."""
        return Inspection(Verdict(Decision.UNKNOWN, COLLECTS, (Cause.NO_TEXTURE,)))
