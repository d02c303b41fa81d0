"""`Collector`: replaces the `Inspector` in a run that captures parts for teaching."""

from capture.sets.captured_set import CapturedSet
from capture.station.domain.verdict import Cause, Decision, Verdict

from .inspector import Inspection

COLLECTS = "this run collects parts for teaching and judges none"


class Collector:
    """Gives every part the verdict UNKNOWN: no part of such a run may pass."""

    def begin(self, unchecked: CapturedSet) -> None:
        """Do nothing: no part is judged."""

    def inspect(self, captured: CapturedSet) -> Inspection:  # noqa: ARG002 - as an inspector
        """Judge nothing."""
        return Inspection(Verdict(Decision.UNKNOWN, COLLECTS, (Cause.NO_TEXTURE,)))
