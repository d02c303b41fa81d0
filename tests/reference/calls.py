"""Events of a station and calls of its HTTP API as Markdown."""

from collections.abc import Iterator
from typing import Any, get_args

from capture.station.domain.roles import Role
from capture.station.domain.verdict import Decision, Verdict
from capture.station.panel.app import DESCRIPTION
from capture.station.panel.filters import FILTERS
from capture.station.panel.guard import V1
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
from tests.capture.station.panel.routes import ROUTES

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
        pages = [f"`{each.path}`" for each in ROUTES if each.role is role and each.is_page]
        lines += ["", f"For the {role}, pages {', '.join(pages)}, and:", "", *_calls(role)]
    return lines


def _calls(role: Role) -> Iterator[str]:
    for path, methods in DESCRIPTION["paths"].items():
        for method, call in methods.items():
            if call["security"] == [{"token": [role]}]:
                given = [each for each in call.get("parameters", []) if each["in"] != "path"]
                names = [each["name"] for each in given] + _fields(call)
                yield _call(f"{method.upper()} {path.removeprefix(V1)}", call["description"], names)


def _fields(call: dict[str, Any]) -> list[str]:
    if "requestBody" not in call:
        return []
    schema = call["requestBody"]["content"]["application/json"]["schema"]
    name = schema.get("anyOf", [schema])[0]["$ref"].rpartition("/")[2]
    return list(DESCRIPTION["components"]["schemas"][name]["properties"])


def _call(call: str, about: str, names: list[str]) -> str:
    lacking = [each for each in FILTERS if each not in names]
    if len(lacking) < len(FILTERS) - 1:
        but = " but " + " and ".join(lacking) if lacking else ""
        names = [f"filters{but}", *(each for each in names if each not in FILTERS)]
    meaning = " ".join(about.split()).partition(". ")[0].rstrip(".")
    return f"- `{call}` {meaning}" + f" [{', '.join(names)}]" * bool(names)
