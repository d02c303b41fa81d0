"""Events of a station and calls of its HTTP API as Markdown."""

from typing import get_args

from capture.station.domain.roles import Role
from capture.station.domain.verdict import Decision, Verdict
from capture.station.panel.api import V1
from capture.station.panel.app import ROUTES
from capture.station.panel.filters import FILTERS
from capture.station.panel.routes import PanelRoute
from capture.station.results.part_result import PartResult
from capture.station.run.events import (
    Device,
    DevicesChanged,
    Event,
    ExposureComplete,
    Noted,
    PartAcknowledged,
    PartAnnounced,
    PartBegun,
    PartRecovered,
    RecipeLoaded,
    SelfTestFinished,
    StateChanged,
    StationStopped,
    TriggerRefused,
    Warned,
    json_fields,
)
from capture.station.run.states import Change, State

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
    Noted(dict.fromkeys(("event", "part_id", "decision", "by"), "override")),
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
    """Return a line for each call of the API, with its query and fields, by role."""
    lines = ["Filters:", "", *(f"- `{name}` {about}" for name, about in FILTERS.items())]
    for role in Role:
        calls = [each for each in ROUTES if each.path.startswith(V1) and each.role is role]
        lines += ["", f"For the {role}:", "", *map(_call, calls)]
    return lines


def _call(route: PanelRoute) -> str:
    names = [*route.query, *route.fields]
    lacking = [each for each in FILTERS if each not in names]
    if len(lacking) < len(FILTERS) - 1:
        but = " but " + " and ".join(lacking) if lacking else ""
        names = [f"filters{but}", *(each for each in names if each not in FILTERS)]
    return (
        f"- `{route.method} {route.path.removeprefix(V1)}` {route.about}"
        + f" [{', '.join(names)}]" * bool(names)
    )
