"""States and events of a station, which terminal, log, panel and PLC follow."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, ClassVar, Literal

from capture.base.outputs import escaped
from capture.station.domain.fault import Fault
from capture.station.domain.verdict import Decision
from capture.station.results.part_result import PartResult
from rig.doctor.check import Check


class State(StrEnum):
    """State of a station, named as in OPC 40100-1."""

    PREOPERATIONAL = "preoperational"  # starting, or ended: no rig, no recipe
    INITIALIZED = "initialized"  # recipe loaded, rig open; the self-test runs
    READY = "ready"  # the next trigger is accepted
    EXECUTING = "executing"  # a part is exposed, or no buffer is free
    ERROR = "error"  # it tries again, or waits for an acknowledgement of errors in a row


class Change(StrEnum):
    """Why a station changes its state."""

    OPENED = "recipe loaded and rig open"
    TESTED = "self-test passed"
    TRIGGERED = "trigger accepted"
    FREE = "exposure complete and a buffer free"
    RECIPE = "another recipe is requested, and no part is exposed"
    FAILED = "rig, disk, database or self-test failed"
    STOPPED = "stopped"


TRANSITIONS: dict[tuple[State, Change], State] = {
    (State.PREOPERATIONAL, Change.OPENED): State.INITIALIZED,
    (State.PREOPERATIONAL, Change.FAILED): State.ERROR,
    (State.INITIALIZED, Change.TESTED): State.READY,
    (State.INITIALIZED, Change.FAILED): State.ERROR,
    (State.READY, Change.TRIGGERED): State.EXECUTING,
    (State.READY, Change.RECIPE): State.INITIALIZED,
    (State.READY, Change.FAILED): State.ERROR,
    (State.EXECUTING, Change.FREE): State.READY,
    (State.EXECUTING, Change.RECIPE): State.INITIALIZED,
    (State.EXECUTING, Change.FAILED): State.ERROR,
    (State.ERROR, Change.OPENED): State.INITIALIZED,
    (State.ERROR, Change.FAILED): State.ERROR,
    **{(state, Change.STOPPED): State.PREOPERATIONAL for state in State},
}
"""Every transition that is allowed; any other is a defect of the program."""


@dataclass(frozen=True)
class RecipeLoaded:
    """A recipe was loaded; it judges all parts that are triggered from now on."""

    kind: ClassVar = "recipe"
    name: str
    version: int
    sha256: str
    by: str = ""  # who asked for it; empty at the start


@dataclass(frozen=True)
class StateChanged:
    """The station is in another state."""

    kind: ClassVar = "state"
    state: State
    change: Change
    fault: Fault | None = None
    why: str = ""  # reason in words, if neither change nor fault gives it

    @property
    def reason(self) -> str:
        """The cause of the change, in words."""
        return self.why or str(self.fault or self.change)


@dataclass(frozen=True)
class SelfTestFinished:
    """The self-test has run; with a fault among its checks the station does not become ready."""

    kind: ClassVar = "self-test"
    checks: tuple[Check, ...]


@dataclass(frozen=True)
class TriggerRefused:
    """A trigger could not be served; `recorded` says whether the refusal is in the results."""

    kind: ClassVar = "refused"
    trigger: str
    part_id: str | None
    reason: str
    recorded: bool
    triggers: int = 1  # refused for the same reason


@dataclass(frozen=True)
class PartBegun:
    """A trigger was accepted, and the part has its row in the results."""

    kind: ClassVar = "begun"
    part_id: str
    number: int


@dataclass(frozen=True)
class ExposureComplete:
    """No further exposure of the part is needed: it may move. Published after the last attempt."""

    kind: ClassVar = "exposed"
    part_id: str
    number: int


@dataclass(frozen=True)
class PartAnnounced:
    """The result of a part; its set file and its row are on disk."""

    kind: ClassVar = "part"
    result: PartResult
    latency_ms: float  # since the end of its last exposure
    fault: Fault | None = None  # of a device, detected in this part


@dataclass(frozen=True)
class PartRecovered:
    """A part that an earlier run began and did not finish; it gets the verdict ERROR."""

    kind: ClassVar = "recovered"
    result: PartResult


@dataclass(frozen=True)
class PartAcknowledged:
    """Somebody has seen a rejected part."""

    kind: ClassVar = "acknowledged"
    part_id: str
    by: str


Status = Literal["ok", "warning", "fault", "unknown", "off"]


@dataclass(frozen=True)
class Device:
    """The state of a device; an event of the PLC, which the self-test does not test."""

    kind: ClassVar = "device"
    name: str  # ``camera``, ``lights``, ``plc``, ``disk`` or ``database``
    status: Status  # ``off``: not configured; ``unknown``: not tested yet
    text: str = ""


@dataclass(frozen=True)
class DevicesChanged:
    """The devices, after an event that changed one of them."""

    kind: ClassVar = "devices"
    devices: tuple[Device, ...]


@dataclass(frozen=True)
class JsonEvent:
    """An action in the panel, such as an override."""

    # The process of a panel also holds the events that it receives in this form.

    fields: Mapping[str, Any]  # ``event`` names its kind


@dataclass(frozen=True)
class Warned:
    """A warning for people; the station goes on."""

    kind: ClassVar = "warning"
    text: str


@dataclass(frozen=True)
class StationStopped:
    """The run is over."""

    kind: ClassVar = "stopped"
    reason: str
    parts: Mapping[Decision, int]
    refused: int  # triggers that were not served

    @property
    def rejected(self) -> int:
        """Number of parts that did not pass."""
        return sum(count for verdict, count in self.parts.items() if verdict != Decision.PASS)


Event = (
    RecipeLoaded
    | StateChanged
    | SelfTestFinished
    | TriggerRefused
    | PartBegun
    | ExposureComplete
    | PartAnnounced
    | PartRecovered
    | PartAcknowledged
    | Device
    | DevicesChanged
    | JsonEvent
    | Warned
    | StationStopped
)

_HASH_DIGITS = 8  # for people to compare
# Fields of an announced result for programs; its row in the results has all.
_RESULT_FIELDS = (
    "part_id", "number", "decision", "causes", "reason", "simulated", "set_file", "chain_sha256",
)  # fmt: skip


def text_lines(event: Event) -> list[str]:
    """Return an event as lines of text for people; many events have none."""
    return [*map(escaped, _lines(event))]


def _lines(event: Event) -> list[str]:
    match event:
        case RecipeLoaded(name, version, sha256, by):
            loaded = f", loaded by {by}" if by else ""
            return [f"recipe {name}, version {version}, {sha256[:_HASH_DIGITS]}{loaded}"]
        case StateChanged(State.EXECUTING) | StateChanged(change=Change.FREE):
            return []  # these occur for every part
        case StateChanged(state):
            return [f"{state}: {event.reason}"]
        case SelfTestFinished(checks):
            lines = []
            for check in checks:
                if check.status != "ok":
                    advice = f"; {check.advice}" if check.advice else ""
                    lines.append(f"self-test: {check.name}: {check.status}: {check.seen}{advice}")
            return lines or [f"self-test: {len(checks)} checks are ok"]
        case TriggerRefused(source, part_id, reason, is_recorded):
            part = f" for {part_id}" if part_id else ""
            remark = "" if is_recorded else "; not in the results"
            return [f"trigger by {source}{part} refused: {reason}{remark}"]
        case PartAnnounced(result, latency_ms):
            return [f"{_part_text(result)} ({latency_ms:.0f} ms)"]
        case PartRecovered(result):
            return [f"{_part_text(result)} (of an earlier run)"]
        case Warned(text):
            return [f"warning: {text}"]
        case StationStopped(reason, parts, refused):
            counts = [f"{parts.get(decision, 0)} {decision}" for decision in Decision]
            return [f"stopped: {reason}; {', '.join(counts)}, {refused} triggers refused"]
        case _:
            return []


def json_fields(event: Event) -> dict[str, Any]:
    """Return an event as fields of JSON; ``event`` names its kind."""
    match event:
        case JsonEvent(fields):
            return dict(fields)
        case PartAnnounced(result, latency_ms):
            return {
                "event": event.kind,
                **_result_fields(result),
                "latency_ms": round(latency_ms, 1),
            }
        case PartRecovered(result):
            return {"event": event.kind, **_result_fields(result)}
        case StateChanged(state, _, fault):
            return {
                "event": event.kind,
                "state": state,
                "reason": event.reason,
                "fault": None if fault is None else asdict(fault),
            }
        case _:
            return {"event": event.kind, **asdict(event)}


def _result_fields(result: PartResult) -> dict[str, Any]:
    return {name: result.row[name] for name in _RESULT_FIELDS}


def _part_text(result: PartResult) -> str:
    simulated = ", simulated" if result.simulated else ""
    notes = "".join(f"; {note}" for note in result.notes)
    verdict = result.verdict
    return f"{result.part_id} {verdict.decision}{simulated}: {verdict.reason}{notes}"
