"""Events of a station, which terminal, log, panel and PLC follow."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from capture.station.domain.fault import Fault
from capture.station.domain.verdict import Decision
from capture.station.results.part_result import PartResult
from rig.doctor.check import Check

from .states import Change, State


@dataclass(frozen=True)
class RecipeLoaded:
    """A recipe was loaded; it judges all parts that are triggered from now on."""

    name: str
    version: int
    sha256: str
    by: str = ""  # who asked for it; empty at the start


@dataclass(frozen=True)
class StateChanged:
    """The station is in another state."""

    state: State
    change: Change
    fault: Fault | None = None
    why: str = ""  # in words, where neither change nor fault says it

    @property
    def reason(self) -> str:
        """Why, in words."""
        return self.why or str(self.fault or self.change)


@dataclass(frozen=True)
class SelfTestFinished:
    """The self-test has run; with a fault among its checks the station does not become ready."""

    checks: tuple[Check, ...]


@dataclass(frozen=True)
class TriggerRefused:
    """A trigger could not be served; `recorded` says whether the refusal is in the results."""

    source: str
    part_id: str | None
    reason: str
    recorded: bool
    triggers: int = 1  # refused for the same reason


@dataclass(frozen=True)
class PartBegun:
    """A trigger was accepted, and the part has its row in the results."""

    part_id: str
    number: int


@dataclass(frozen=True)
class ExposureComplete:
    """No further exposure of the part is needed: it may move. Published after the last attempt."""

    part_id: str
    number: int


@dataclass(frozen=True)
class PartAnnounced:
    """The result of a part; its set file and its row are on disk."""

    result: PartResult
    latency_ms: float  # since the end of its last exposure
    fault: Fault | None = None  # of a device, which the part has shown


@dataclass(frozen=True)
class PartRecovered:
    """A part that an earlier run began and did not finish got the verdict ERROR."""

    result: PartResult


@dataclass(frozen=True)
class PartAcknowledged:
    """Somebody has seen a rejected part."""

    part_id: str
    by: str


@dataclass(frozen=True)
class DeviceSeen:
    """A device that the self-test does not test, the PLC, is in another state."""

    name: str
    status: Literal["ok", "warning", "fault"]
    text: str


@dataclass(frozen=True)
class DevicesChanged:
    """The devices, after an event that changed one of them."""

    devices: tuple[Mapping[str, str], ...]


@dataclass(frozen=True)
class Noted:
    """Something that an interface did, such as an override."""

    fields: Mapping[str, Any]  # for JSON; ``event`` names its kind


@dataclass(frozen=True)
class Warned:
    """A warning for people; the station goes on."""

    text: str


@dataclass(frozen=True)
class StationStopped:
    """The run is over."""

    reason: str
    announced: Mapping[Decision, int]
    refused: int  # triggers that were not served

    @property
    def rejected(self) -> int:
        """Number of parts that did not pass."""
        return sum(count for verdict, count in self.announced.items() if verdict != Decision.PASS)


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
    | DeviceSeen
    | DevicesChanged
    | Noted
    | Warned
    | StationStopped
)
