"""`StationState`: the state of a station at one moment, and how each event changes it."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from capture.station.domain.fault import Fault
from capture.station.domain.verdict import Cause, Decision
from capture.station.results.part_result import PartResult
from rig.doctor.check import Check

from .events import (
    Change,
    Device,
    Event,
    PartAcknowledged,
    PartAnnounced,
    PartBegun,
    RecipeLoaded,
    SelfTestFinished,
    State,
    StateChanged,
    Status,
    TriggerRefused,
    Warned,
)

# Number of rejected parts on the operator's page.
_KEPT_REJECTED = 12
_KEPT_WARNINGS = 12
_GRAVITY: tuple[Status, ...] = ("off", "ok", "unknown", "warning", "fault")  # rising
_RIG_DEVICES = ("camera", "lights")
STARTING = "the station is starting"
_UNTESTED = (
    Device("camera", "unknown", "not tested yet"),
    Device("lights", "unknown", "not tested yet"),
    Device("plc", "off", "no PLC is configured"),
    Device("disk", "unknown", "not tested yet"),
    Device("database", "unknown", "not tested yet"),
)


@dataclass(frozen=True)
class _RejectedPart:
    """A part that did not pass, and who acknowledged it; None if nobody did."""

    result: PartResult
    acknowledged_by: str | None = None


@dataclass(frozen=True)
class StationState:
    """The state of a station at one moment."""

    station: str
    simulated: bool
    trigger: str
    tested: tuple[Device, ...] = _UNTESTED  # the devices after the last self-test
    reason: str = STARTING
    run: str = ""  # a random name of this run; empty without a run
    event_id: int = 0  # of the last event in the state
    state: State = State.PREOPERATIONAL
    fault: Fault | None = None  # why the state is ``error``
    faults: tuple[Fault, ...] = ()  # since the last self-test that passed, one for each device
    warnings: tuple[str, ...] = ()  # the last ones of this run
    recipe: RecipeLoaded | None = None  # None before it is loaded
    inspected: str | None = None  # the latest part, until its result is announced
    last: PartResult | None = None
    latency_ms: float | None = None  # from exposure to announcement; None before the first
    total_latency_ms: float = 0.0  # sum over all parts of this run
    announced: Mapping[Decision, int] = field(default_factory=dict)
    refused: int = 0
    parts_per_minute: float = 0.0  # over the last minute
    rejected: tuple[_RejectedPart, ...] = ()  # the last ones, the newest first
    subscribers: int = 0  # browsers and programs that follow the events

    @property
    def devices(self) -> tuple[Device, ...]:
        """All devices: as they were tested, unless they failed since."""
        failed = {
            name: Device(name, "fault", str(fault))
            for fault in self.faults
            for name in _names_of(fault.device)
        }
        return tuple(failed.get(device.name, device) for device in self.tested)

    @property
    def is_stopped_by_errors(self) -> bool:
        """Whether the line is stopped until somebody acknowledges the errors in a row."""
        return self.fault is not None and self.fault.in_a_row > 0

    def fields(self) -> dict[str, Any]:
        """Return the state as fields of JSON."""
        fields = dict(vars(self)) | {
            "fault": None if self.fault is None else asdict(self.fault),
            "faults": [asdict(fault) for fault in self.faults],
            "recipe": None if self.recipe is None else vars(self.recipe),
            "last": None if self.last is None else {**self.last.row, "latency_ms": self.latency_ms},
            "announced": {decision.value: self.announced.get(decision, 0) for decision in Decision},
            "devices": [vars(device) for device in self.devices],
            "rejected": [
                {**part.result.row, "acknowledged_by": part.acknowledged_by}
                for part in self.rejected
            ],
        }
        del fields["tested"]
        return fields


def changes_by(event: Event, before: StationState) -> dict[str, Any]:
    """Return the fields of a state that an event changes, with their new values."""
    match event:
        case RecipeLoaded():
            return {"recipe": event}
        case StateChanged():
            is_tested = event.change is Change.TESTED
            faults = () if is_tested else _with_fault(before.faults, event.fault)
            return {
                "state": event.state,
                "reason": event.reason,
                "fault": event.fault,
                "faults": faults,
            }
        case SelfTestFinished(checks):
            return {"tested": _after_self_test(before.tested, checks)}
        case Device():
            return {"tested": _with_devices(before.tested, [event])}
        case TriggerRefused():
            return {"refused": before.refused + event.triggers}
        case PartBegun(part_id):
            return {"inspected": part_id}
        case PartAnnounced():
            return _announced(event, before)
        case PartAcknowledged(part_id, by):
            rejected = (
                replace(part, acknowledged_by=by) if part.result.part_id == part_id else part
                for part in before.rejected
            )
            return {"rejected": tuple(rejected)}
        case Warned(text):
            return {"warnings": (*before.warnings, text)[-_KEPT_WARNINGS:]}
        case _:
            return {}


def _announced(event: PartAnnounced, before: StationState) -> dict[str, Any]:
    result, decision = event.result, event.result.verdict.decision
    changes = {
        "last": result,
        "latency_ms": event.latency_ms,
        "total_latency_ms": before.total_latency_ms + event.latency_ms,
        "announced": {**before.announced, decision: before.announced.get(decision, 0) + 1},
    }
    if before.inspected == result.part_id:
        changes["inspected"] = None
    if decision is not Decision.PASS and Cause.COLLECTED not in result.verdict.causes:
        changes["rejected"] = (_RejectedPart(result), *before.rejected)[:_KEPT_REJECTED]
    if event.fault is not None:
        changes["faults"] = _with_fault(before.faults, event.fault)
    elif result.led_levels and Cause.RIG not in result.verdict.causes:
        # New levels replace a fault that was measured from levels, such as a weak LED. A lost
        # controller stays a fault: this part may have been captured before the loss.
        changes["faults"] = tuple(
            fault for fault in before.faults if fault.device != "lights" or fault.measured is None
        )
    return changes


def _with_fault(faults: tuple[Fault, ...], fault: Fault | None) -> tuple[Fault, ...]:
    if fault is None or not fault.device:
        return faults
    return (*(other for other in faults if other.device != fault.device), fault)


def _names_of(device: str) -> tuple[str, ...]:
    """Return the devices that a check or fault concerns: ``rig`` is the camera or the lights."""
    return _RIG_DEVICES if device == "rig" else (device,)


def _with_devices(before: tuple[Device, ...], changed: Iterable[Device]) -> tuple[Device, ...]:
    by_name = {device.name: device for device in changed}
    return tuple(by_name.get(device.name, device) for device in before)


def _after_self_test(before: tuple[Device, ...], checks: Iterable[Check]) -> tuple[Device, ...]:
    """Return the devices after a self-test: each has its gravest check."""
    gravest: dict[str, Check] = {}
    counts: Counter[str] = Counter()
    for check in checks:
        for name in _names_of(check.device):
            counts[name] += 1
            other = gravest.get(name)
            if other is None or _GRAVITY.index(check.status) > _GRAVITY.index(other.status):
                gravest[name] = check
    devices = {
        name: Device(name, check.status, f"{check.name}: {check.seen}")
        for name, check in gravest.items()
    }
    for name, device in devices.items():
        if device.status == "ok" and counts[name] > 1:
            devices[name] = Device(name, "ok", f"{counts[name]} checks are ok")
    if "lights" in devices and "camera" not in devices:
        # The checks of the lights measured images of the camera.
        devices["camera"] = Device("camera", "ok", "light images were captured")
    return _with_devices(before, devices.values())
