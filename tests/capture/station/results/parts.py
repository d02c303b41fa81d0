"""Parts and results for tests of the results."""

from capture.station.domain.verdict import Cause, Decision, Verdict
from capture.station.results.part_result import PartResult
from capture.station.results.store import BegunPart, ResultStore

UTC = "2026-11-22T17:08:13.042Z"
CAUSES = {
    Decision.PASS: (),
    Decision.FAIL: (Cause.DEFECT,),
    Decision.UNKNOWN: (Cause.NO_TEXTURE,),
    Decision.ERROR: (Cause.CAPTURE,),
}


def begin(store: ResultStore, part_id: str | None = None, **more: object) -> BegunPart:
    values = {"trigger": "timer", "triggered_utc": UTC, "simulated": False} | more
    return store.begin(**values, part_id=part_id)


def result_of(
    begun: BegunPart, decision: Decision = Decision.PASS, station: str = "line-1", **more: object
) -> PartResult:
    values = vars(begun) | {
        "station": station,
        "exposed_utc": begun.triggered_utc,
        "decided_utc": begun.triggered_utc,
        "verdict": Verdict(decision, f"it is a {decision}", CAUSES[decision]),
        "operator": "Jo",
        "software_version": "0.1.0",
    }
    return PartResult(**values | more)


def inspect(store: ResultStore, decision: Decision = Decision.PASS, **more: object) -> PartResult:
    """Begin a part and record its result."""
    of_part = {
        name: more.pop(name) for name in ("part_id", "triggered_utc", "simulated") if name in more
    }
    result = result_of(begin(store, **of_part), decision, store.station, **more)
    store.add(result)
    return result
