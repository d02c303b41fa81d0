"""Events of a station and calls of its HTTP API as Markdown."""

from typing import get_args

from capture.station.domain.users import Role
from capture.station.domain.verdict import Decision, Verdict
from capture.station.panel.app import DESCRIPTION
from capture.station.panel.guard import V1
from capture.station.results.part_result import PartResult
from capture.station.run.events import (
    Change,
    Device,
    DevicesChanged,
    Event,
    ExposureComplete,
    JsonEvent,
    PartAcknowledged,
    PartAnnounced,
    PartBegun,
    PartRecovered,
    RecipeLoaded,
    SelfTestFinished,
    State,
    StateChanged,
    StationStopped,
    TriggerRefused,
    Warned,
    json_fields,
)

_RESULT = PartResult(
    station="line-3", part_id="part-000001", number=1, trigger="timer",
    triggered_utc="2026-11-22T17:08:13.042Z", exposed_utc=None,
    decided_utc="2026-11-22T17:08:13.042Z", verdict=Verdict(Decision.PASS, ""), operator=None,
    simulated=True, software_version="",
)  # fmt: skip
_EVENTS: tuple[Event, ...] = (
    RecipeLoaded("", 1, ""),
    SelfTestFinished(()),
    StateChanged(State.READY, Change.TESTED),
    PartBegun("", 1),
    ExposureComplete("", 1),
    PartAnnounced(_RESULT, 0.0),
    PartRecovered(_RESULT),
    PartAcknowledged("", ""),
    Device("plc", "ok", ""),
    DevicesChanged(()),
    JsonEvent(dict.fromkeys(("event", "part_id", "decision", "by"), "override")),
    TriggerRefused("", None, "", recorded=True),
    Warned(""),
    StationStopped("", {}, 0),
)


def event_lines() -> list[str]:
    """Return a line for each event of ``station run --json``, with its fields."""
    missing = set(get_args(Event)) - {type(each) for each in _EVENTS}
    if missing:
        raise ValueError(f"no example of {missing}; add one to _EVENTS")
    lines = []
    for event in _EVENTS:
        name, *fields = json_fields(event).items()
        meaning = (event.__doc__ or "").partition(". ")[0].rstrip(".")
        lines.append(f"- `{name[1]}` {meaning} [{', '.join(key for key, _ in fields)}]")
    return lines


def call_lines() -> list[str]:
    """Return a line for each role and method: the paths of the API that it may use."""
    paths: dict[tuple[str, str], list[str]] = {}
    for path, calls in DESCRIPTION["paths"].items():
        for method, call in calls.items():
            [role] = call["security"][0]["token"]
            paths.setdefault((role, method.upper()), []).append(f"`{path.removeprefix(V1)}`")
    return [
        f"- {role}, {method}: {', '.join(allowed)}"
        for role in Role
        for (needed, method), allowed in paths.items()
        if needed == role
    ]
