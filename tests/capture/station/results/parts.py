"""Parts and results for tests of the results."""

from pathlib import Path

from capture.station.domain.verdict import Cause, Decision, Verdict
from capture.station.results.part_result import DefectRecord, PartResult
from capture.station.results.schema import refused_triggers
from capture.station.results.store import BegunPart, ResultStore, open_store

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


def minimal(**more: object) -> PartResult:
    """A result with the fields that each has."""
    values = {"station": "line-1", "part_id": "part-000001", "number": 1, "trigger": "timer",
              "triggered_utc": UTC, "exposed_utc": None, "decided_utc": UTC,
              "verdict": Verdict(Decision.PASS, "like oak"), "operator": None, "simulated": False,
              "software_version": "0.1.0"}  # fmt: skip
    return PartResult(**values | more)


def record_three_days(path: Path) -> None:
    """Record five parts of station line-1, one simulated and one overridden, and begin a sixth."""
    with open_store(str(path), "line-1", create=True) as store:
        for part_id, minute, decision in (
            (None, "20T08:00", Decision.PASS),
            (None, "20T08:01", Decision.FAIL),
            ("A-17", "20T08:02", Decision.PASS),
            (None, "21T08:03", Decision.UNKNOWN),
            (None, "21T08:04", Decision.PASS),
        ):
            inspect(
                store,
                decision,
                part_id=part_id,
                triggered_utc=f"2026-11-{minute}:00.042Z",
                simulated=minute == "21T08:04",
                recipe="oak",
                recipe_version=3,
                label="oak",
                nearest="oak",
                distance=0.25,
                defects=(DefectRecord("relief", 10, 20, 8, 60, 120, 2.5),),
                led_levels=(1.0, 0.99, 1.01, 1.0),
                timings_ms={"inspect": 40.5},
                notes=("Müller's part",),
            )
        utc = "2026-11-22T09:00:00.000Z"
        begin(store, trigger="enter", triggered_utc=utc)
        refuse(store, utc)
        store.override("part-000002", decision=Decision.PASS, by="Kim", reason="a hair", utc=utc)


def refuse(store: ResultStore, utc: str = UTC) -> None:
    """Record a trigger that was refused."""
    row = {"trigger": "enter", "utc": utc, "part_id": None, "reason": "busy", "simulated": False}
    store.append(refused_triggers, row)
