"""Parts that a part sensor triggers, on the simulated controller."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.domain.config import StationConfig
from capture.station.domain.recipe import Recipe
from capture.station.domain.verdict import Decision
from capture.station.judge.inspector import Collector
from capture.station.run.cycle import Station
from capture.station.run.equipment import Equipment
from capture.station.run.events import PartAnnounced, TriggerRefused
from capture.station.run.live_station import LiveStation
from capture.station.run.outcome import PartJudge
from capture.station.run.station_rig import StationRig
from capture.station.run.triggers import MAX_RECORDED, PartSensor, Refused, SensorTrigger, Trigger
from rig import RigConfig, Simulation
from tests.capture.station.stations import Bench, bench, small_set


class WatchedRig(StationRig):
    """Does what a test says when the first part is captured."""

    on_first: Callable[[Simulation], None] = staticmethod(lambda _: None)

    def capture(self, number: int) -> tuple[CapturedSet, float]:
        if number == 1:
            self.on_first(self._opened().simulation)
        return super().capture(number)


class Line:
    """A station whose rig has a part sensor; events are in those of its bench."""

    def __init__(self, made: Bench, synchronisation: str = "trigger") -> None:
        self.bench = made
        values = made.folder.config.model_dump() | {
            "timer_s": 0.2,
            "max_trigger_age_s": 60.0,
            "disk_floor_mb": 1,
            "reconnect_s": 0.01,
        }
        self.config = StationConfig.model_validate(values)
        camera = {"width_px": 32, "height_px": 32}
        config = RigConfig().with_changes(
            camera=camera, lights={"synchronisation": synchronisation}
        )
        collector = Collector(Recipe(name="sheet", passes=("rock",)))
        self.rig = WatchedRig(self.config, config, collector)

    def run(self, count: int) -> None:
        store, clock = self.bench.store, self.bench.clock

        def save(captured: CapturedSet, set_file: str) -> None:
            path = self.bench.folder.path / set_file
            path.parent.mkdir(parents=True, exist_ok=True)
            captured.save(path)

        live = LiveStation("line-1", simulated=True)
        with live.telling(self.bench.tell):
            judge = PartJudge(self.config.name, "Ada", self.bench.inspector, {}, save, clock)
            sensor = PartSensor(self.rig, store)
            parts = Equipment(self.rig, judge, store, list, clock, live, sensor)
            Station(self.bench.folder.path, self.config, parts, count).run(SensorTrigger())


@pytest.fixture(params=["trigger", "strobe"])
def line(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Line]:
    with bench(tmp_path / "line-1", small_set()) as made:
        yield Line(made, request.param)


def test_each_part_at_the_sensor_is_inspected(line: Line) -> None:
    line.run(4)
    results = [event.result for event in line.bench.of(PartAnnounced)]
    assert [(each.number, each.trigger) for each in results] == [
        (n, "sensor") for n in (1, 2, 3, 4)
    ]
    assert {each.verdict.decision for each in results} == {Decision.PASS}
    assert line.bench.rows() == line.bench.announced()
    assert not line.bench.of(TriggerRefused)


def test_a_part_during_an_exposure_is_on_record_as_refused(line: Line) -> None:
    line.rig.on_first = Simulation.see_part
    line.run(2)
    assert [event.trigger for event in line.bench.of(TriggerRefused)] == ["sensor"]
    assert [event.result.number for event in line.bench.of(PartAnnounced)] == [1, 2]


def test_a_controller_that_is_lost_during_a_set_makes_the_part_an_error(line: Line) -> None:
    line.rig.on_first = Simulation.unplug_lights
    line.run(2)
    first, second = (event.result for event in line.bench.of(PartAnnounced))
    assert first.verdict.decision is Decision.ERROR
    assert second.verdict.decision is Decision.PASS


def test_parts_that_pass_while_the_rig_is_opened_again_are_missed(
    line: Line, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[int] = []
    monkeypatch.setattr("capture.station.run.station_rig.parts_seen", lambda _: seen.pop())

    def missed(counter: int) -> int:
        seen.append(counter)
        return line.rig.missed_parts()

    line.rig.open()
    assert [missed(3), missed(5)] == [0, 2]
    line.rig.close()
    line.rig.open()
    assert missed(9) == 4
    line.rig.close()
    line.rig.open()
    assert missed(2) == 2  # the controller was restarted
    line.rig.close()


def test_missed_parts_beyond_a_bound_share_a_row(
    line: Line, monkeypatch: pytest.MonkeyPatch
) -> None:
    missed = [MAX_RECORDED + 7]
    monkeypatch.setattr(line.rig, "missed_parts", lambda: missed.pop() if missed else 0)
    line.run(1)
    reasons = [event.reason for event in line.bench.of(TriggerRefused)]
    assert len(reasons) == MAX_RECORDED + 1
    assert reasons[-1].startswith("parts that passed the sensor")
    assert reasons[-1].endswith(": 7")


def test_missed_parts_do_not_hold_up_a_station_whose_database_is_locked(
    line: Line, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused: list[str] = []

    class Slow:
        """Each record takes the timeout of the store."""

        def refuse(self, _: Trigger, reason: str) -> Refused:
            refused.append(reason)
            return Refused(reason)

    monkeypatch.setattr(line.rig, "missed_parts", lambda: 5)
    monkeypatch.setattr(line.rig, "wait_for_part", lambda *_: False)
    # It also tells the watchdog that the station is alive.
    PartSensor(line.rig, line.bench.store).await_part(Slow(), lambda: len(refused) == 2)  # type: ignore[arg-type]
    assert [reason.partition(" ")[0] for reason in refused] == ["the", "the", "parts"]
    assert refused[-1].endswith(": 3")
