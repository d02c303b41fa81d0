"""Events of a station as lines of text for people and the log, and as JSON for programs."""

from dataclasses import asdict
from typing import Any

from capture.base.outputs import escaped
from capture.station.domain.verdict import Decision
from capture.station.results.part_result import PartResult

from .events import (
    DevicesChanged,
    DeviceSeen,
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
)
from .states import Change, State

_DIGITS = 8  # of a hash, for people to compare


def text_lines(event: Event) -> list[str]:
    """Return an event as lines of text for people; many events have none."""
    return [*map(escaped, _lines(event))]


def _lines(event: Event) -> list[str]:
    match event:
        case RecipeLoaded(name, version, sha256, by):
            loaded = f", loaded by {by}" if by else ""
            return [f"recipe {name}, version {version}, {sha256[:_DIGITS]}{loaded}"]
        case StateChanged(State.EXECUTING) | StateChanged(change=Change.FREE):
            return []  # of every part
        case StateChanged(state):
            return [f"{state}: {event.reason}"]
        case SelfTestFinished(checks):
            faults = [check for check in checks if check.status != "ok"]
            lines = [
                f"self-test: {check.name}: {check.status}: {check.seen}; {check.advice}".rstrip(
                    "; "
                )
                for check in faults
            ]
            return lines or [f"self-test: {len(checks)} checks are ok"]
        case TriggerRefused(source, part_id, reason, is_recorded):
            part = f" for {part_id}" if part_id else ""
            lost = "" if is_recorded else "; not in the results"
            return [f"trigger by {source}{part} refused: {reason}{lost}"]
        case PartAnnounced(result, latency_ms):
            return [f"{_part(result)} ({latency_ms:.0f} ms)"]
        case PartRecovered(result):
            return [f"{_part(result)} (of an earlier run)"]
        case Warned(text):
            return [f"warning: {text}"]
        case StationStopped(reason, announced, refused):
            counts = [f"{announced.get(decision, 0)} {decision}" for decision in Decision]
            return [f"stopped: {reason}; {', '.join(counts)}, {refused} triggers refused"]
        case _:
            return []


def json_fields(event: Event) -> dict[str, Any]:
    """Return an event as fields of JSON; ``event`` names its kind."""
    match event:
        case RecipeLoaded():
            return {"event": "recipe", **vars(event)}
        case StateChanged(state, _, fault):
            return {
                "event": "state", "state": state, "reason": event.reason,
                "fault": None if fault is None else asdict(fault),
            }  # fmt: skip
        case SelfTestFinished(checks):
            return {"event": "self-test", "checks": [vars(check) for check in checks]}
        case TriggerRefused(source, part_id, reason, is_recorded):
            return {
                "event": "refused", "trigger": source, "part_id": part_id, "reason": reason,
                "recorded": is_recorded, "triggers": event.triggers,
            }  # fmt: skip
        case PartBegun(part_id, number):
            return {"event": "begun", "part_id": part_id, "number": number}
        case ExposureComplete(part_id, number):
            return {"event": "exposed", "part_id": part_id, "number": number}
        case PartAnnounced(result, latency_ms):
            return {"event": "part", **_fields(result), "latency_ms": round(latency_ms, 1)}
        case PartRecovered(result):
            return {"event": "recovered", **_fields(result)}
        case PartAcknowledged():
            return {"event": "acknowledged", **vars(event)}
        case DeviceSeen():
            return {"event": "device", **vars(event)}
        case DevicesChanged(devices):
            return {"event": "devices", "devices": list(devices)}
        case Noted(fields):
            return dict(fields)
        case Warned(text):
            return {"event": "warning", "text": text}
        case StationStopped(reason, announced, refused):
            return {
                "event": "stopped", "reason": reason, "parts": dict(announced), "refused": refused
            }  # fmt: skip


def _part(result: PartResult) -> str:
    simulated = ", simulated" if result.simulated else ""
    notes = "".join(f"; {note}" for note in result.notes)
    verdict = result.verdict
    return f"{result.part_id} {verdict.decision}{simulated}: {verdict.reason}{notes}"


def _fields(result: PartResult) -> dict[str, Any]:
    verdict = result.verdict
    return {
        "part_id": result.part_id,
        "number": result.number,
        "decision": verdict.decision,
        "causes": list(verdict.causes),
        "reason": verdict.reason,
        "simulated": result.simulated,
        "set_file": result.set_file,
        "chain_sha256": result.chain_sha256,
    }
