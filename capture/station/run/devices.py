"""States of camera, lights, PLC, disk and database, from the events of a station."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from capture.station.domain.verdict import Cause
from capture.station.run.events import Event, PartAnnounced, SelfTestFinished, StateChanged
from capture.station.run.states import Change, State
from rig.doctor.check import Check

Status = Literal["ok", "warning", "fault", "unknown", "off"]
_GRAVITY: tuple[Status, ...] = ("off", "ok", "unknown", "warning", "fault")
_OF_THE_RIG = ("camera", "lights")
_NAMES = (*_OF_THE_RIG, "plc", "disk", "database")
# Devices of each check of the self-test, by the beginning of its name; others test the camera.
_CHECKED = {
    "disk": ("disk",),
    "results": ("database",),
    "LED": ("lights",),
    "ambient light": ("lights",),
    "light controller": ("lights",),
    "rig": _OF_THE_RIG,  # nothing could be checked
    "clock": (),
    "calibration": (),
}


@dataclass(frozen=True)
class Device:
    """The state of a device."""

    name: str  # ``camera``, ``lights``, ``plc``, ``disk`` or ``database``
    status: Status  # ``off``: not configured; ``unknown``: not tested yet
    text: str = ""


class DeviceStates:
    """The last known state of each device."""

    def __init__(self, database: str) -> None:
        self._database = database
        self._tested = {name: Device(name, "unknown", "not tested yet") for name in _NAMES}
        self._tested["plc"] = Device("plc", "off", "no PLC is configured")
        # Failures since the last self-test that passed.
        self._failed: dict[str, Device] = {}
        self._has_weak_led = False  # of the last part with measured levels

    def all(self) -> tuple[Device, ...]:
        """Return all devices."""
        return tuple((self._tested | self._failed).values())

    def set(self, device: Device) -> None:
        """Replace the state of a device."""
        self._tested[device.name] = device

    def take(self, event: Event) -> None:
        """Learn from an event of the station."""
        match event:
            case SelfTestFinished(checks):
                self._learn(checks)
            case StateChanged(State.ERROR, reason) if not reason.startswith("self-test"):
                self._fail(self._at_fault(reason), reason)
            case StateChanged(State.READY, reason) if reason != Change.FREE:
                self._failed.clear()
            case PartAnnounced(result, _) if Cause.RIG in result.verdict.causes:
                # Levels were measured: the camera works, and an LED is weak.
                is_weak = bool(result.led_levels)
                self._fail(("lights",) if is_weak else _OF_THE_RIG, result.verdict.reason)
                self._has_weak_led = is_weak
            case PartAnnounced(result, _) if Cause.STORAGE in result.verdict.causes:
                self._fail(("disk",), result.verdict.reason)
            case PartAnnounced(result, _) if result.led_levels and self._has_weak_led:
                self._failed.pop("lights", None)
                self._has_weak_led = False
            case _:
                pass

    def _at_fault(self, reason: str) -> tuple[str, ...]:
        failed = self._failed.get("disk")
        # A set that could not be written fails its part first, then the station, by one reason.
        if reason.startswith("disk") or (failed is not None and failed.text == reason):
            return ("disk",)
        return ("database",) if reason.startswith(self._database) else _OF_THE_RIG

    def _fail(self, names: Iterable[str], text: str) -> None:
        self._failed |= {name: Device(name, "fault", text) for name in names}
        self._has_weak_led = False

    def _learn(self, checks: Iterable[Check]) -> None:
        devices: dict[str, Device] = {}
        counts: Counter[str] = Counter()
        for check in checks:
            prefixes = [prefix for prefix in _CHECKED if check.name.startswith(prefix)]
            for name in _CHECKED[prefixes[0]] if prefixes else ("camera",):
                counts[name] += 1
                is_of_one_device = len(_CHECKED.get(check.name, ())) == 1
                seen = check.seen if is_of_one_device else f"{check.name}: {check.seen}"
                device = Device(name, check.status, seen)
                before = devices.get(name)
                if before is None or _GRAVITY.index(device.status) > _GRAVITY.index(before.status):
                    devices[name] = device
        for name, device in devices.items():
            if device.status == "ok" and counts[name] > 1:
                devices[name] = Device(name, "ok", f"{counts[name]} checks are ok")
        if "lights" in devices and "camera" not in devices:
            # Light was measured, with the camera.
            devices["camera"] = Device("camera", "ok", "light images were captured")
        self._tested |= devices
