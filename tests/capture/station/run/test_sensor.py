"""Parts that a part sensor triggers, on the simulated controller."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.domain.recipe import Recipe
from capture.station.domain.verdict import Decision
from capture.station.judge.inspector import Collector
from capture.station.run.events import PartAnnounced, TriggerRefused
from capture.station.run.station_rig import StationRig
from capture.station.run.triggers import MAX_RECORDED, PartSensor, Refused, SensorTrigger, Trigger
from rig import RigConfig, Simulation
from tests.capture.station.stations import Bench, bench


class WatchedRig(StationRig):
    """Does what a test says when the first part is captured."""

    on_first: Callable[[Simulation], None] = staticmethod(lambda _: None)

    def capture(self, number: int) -> tuple[CapturedSet, float]:
        if number == 1:
            self.on_first(self._opened().simulation)
        return super().capture(number)


@dataclass
class Line:
    """A station whose rig has a part sensor; events are in those of its bench."""

    bench: Bench
    rig: WatchedRig

    def run(self, count: int) -> None:
        self.bench.run(SensorTrigger(), count)


@pytest.fixture(params=["trigger", "strobe"])
def line(request: pytest.FixtureRequest, tmp_path: Path, captured: CapturedSet) -> Iterator[Line]:
    config = RigConfig().with_changes(
        camera={"width_px": 32, "height_px": 32}, lights={"synchronisation": request.param}
    )
    with bench(tmp_path / "line-1", captured) as made:
        quick = made.folder.config.model_copy(update={"timer_s": 0.2})
        rig = WatchedRig(quick, config, Collector(Recipe(name="sheet", passes=("rock",))))
        made.camera, made.sensor = rig, PartSensor(rig, made.store)  # type: ignore[assignment]
        yield Line(made, rig)


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
    monkeypatch.setattr("capture.station.run.station_rig.detected_part_count", lambda _: seen.pop())

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

        def refuse(self, _: Trigger, answer: Refused) -> Refused:
            refused.append(answer.reason)
            return answer

    monkeypatch.setattr(line.rig, "missed_parts", lambda: 5)
    monkeypatch.setattr(line.rig, "wait_for_part", lambda *_: False)
    # It also tells the watchdog that the station is alive.
    PartSensor(line.rig, line.bench.store).await_part(Slow(), lambda: len(refused) == 2)  # type: ignore[arg-type]
    assert [reason.partition(" ")[0] for reason in refused] == ["the", "the", "parts"]
    assert refused[-1].endswith(": 3")
