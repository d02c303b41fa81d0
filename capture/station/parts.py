"""`Parts`: what the cycle of a station works with."""

from collections.abc import Callable
from dataclasses import dataclass

from rig.doctor.check import Check

from .events import Publisher
from .outcome import PartJudge
from .part_sensor import PartSensor
from .results.store import ResultStore
from .station_clock import StationClock
from .station_rig import PartCamera


@dataclass(frozen=True, eq=False)
class Parts:
    """What a station works with.

    Attributes
    ----------
    camera
        Its rig.
    judge
        Makes the result of an exposed part.
    store
        Its results.
    prepare
        Checks all but the rig, before the station becomes ready; no part is in progress then.
    clock
        For times of records.
    publisher
        Gets all events.
    sensor
        The part sensor, if that triggers.
    """

    camera: PartCamera
    judge: PartJudge
    store: ResultStore
    prepare: Callable[[], list[Check]]
    clock: StationClock
    publisher: Publisher
    sensor: PartSensor | None = None
