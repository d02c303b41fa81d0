"""A fault that returns is a lasting one: the PLC does not see Ready again and again."""

import shutil
import sqlite3
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import event

from capture.base.errors import SetRejected
from capture.sets.captured_set import CapturedSet
from capture.station.domain.verdict import Decision
from capture.station.results.database import ResultsUnavailable
from capture.station.run.cycle import Station
from capture.station.run.events import PartAnnounced, State, StateChanged
from capture.station.run.self_test import check_disk, check_results
from capture.station.run.triggers import Refused, Trigger
from rig import CameraError
from tests.capture.station.stations import Bench, Manual, bench

LIMIT = 3


@pytest.fixture
def station(tmp_path: Path, captured: CapturedSet) -> Iterator[Bench]:
    with bench(tmp_path / "line-1", captured) as made:
        yield made


def rejected(_: int) -> None:
    raise SetRejected("set rejected: LED 1 gives 61 %")


def unplugged(_: int) -> None:
    raise CameraError("the camera was unplugged")


def trigger_until(target: Station, text: str) -> Refused:
    """Trigger whenever the station is ready, until a refusal holds a text."""
    given_up_s = time.monotonic() + 30.0
    while time.monotonic() < given_up_s:
        target.wait_until_ready(0.05)
        answer = target.submit(Trigger("timer"))
        if isinstance(answer, Refused) and text in answer.reason:
            return answer
    raise AssertionError("it goes on")


@pytest.mark.parametrize("fault", [rejected, unplugged])
def test_an_endless_row_of_errors_stops_the_line_until_somebody_resumes(
    station: Bench, fault: Any
) -> None:
    station.camera.on_capture = fault

    def feed(target: Station) -> None:
        trigger_until(target, "stop_after_errors")
        assert not target.wait_until_ready(0.2)
        station.camera.on_capture = lambda _: None
        target.resume()
        assert target.wait_until_ready(30.0)
        target.submit(Trigger("timer"))

    station.run(Manual(feed), stop_after_errors=LIMIT, buffers=1)
    decisions = [announced.result.verdict.decision for announced in station.of(PartAnnounced)]
    assert decisions == [*LIMIT * [Decision.ERROR], Decision.PASS]
    *_, stopped, resumed = (
        change.reason for change in station.of(StateChanged) if change.state is State.ERROR
    )
    cause = "LED 1 gives 61 %" if fault is rejected else "the camera was unplugged"
    assert stopped.startswith(f"{resumed}; {LIMIT} errors in a row")
    assert cause in resumed
    assert "stop_after_errors" in stopped


def test_a_part_that_is_judged_ends_the_row_of_errors(station: Bench) -> None:
    def sometimes(number: int) -> None:
        if number % LIMIT:
            rejected(number)

    station.camera.on_capture = sometimes

    def feed(target: Station) -> None:
        for _ in range(3 * LIMIT):
            assert target.wait_until_ready(30.0)
            target.submit(Trigger("timer"))

    station.run(Manual(feed), stop_after_errors=LIMIT, buffers=1)
    assert len(station.of(PartAnnounced)) == 3 * LIMIT


def test_triggers_that_fail_again_and_again_stop_the_line(station: Bench) -> None:
    """The self-test does not find this fault of the database."""

    def fail(**_: Any) -> None:
        raise ResultsUnavailable("results.sqlite: a strange fault")

    station.store.begin = fail  # type: ignore[method-assign, assignment]

    def feed(target: Station) -> None:
        assert "a strange fault" in trigger_until(target, "stop_after_errors").reason

    station.run(Manual(feed), stop_after_errors=LIMIT, buffers=1)
    assert [change.state for change in station.of(StateChanged)].count(State.READY) == LIMIT


def test_the_self_test_finds_a_database_that_cannot_be_written(station: Bench) -> None:
    assert {check.status for check in check_results(station.store)} == {"ok"}

    @event.listens_for(station.store._writer.engine, "checkout")
    def _only_read(connection: sqlite3.Connection, *_: object) -> None:
        connection.execute("PRAGMA query_only = ON")

    with pytest.raises(ResultsUnavailable, match="readonly"):
        list(check_results(station.store))


def test_the_self_test_writes_a_file_of_the_size_of_a_set(
    station: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = shutil.disk_usage(station.folder.path)._replace(free=6_000_000)
    monkeypatch.setattr("shutil.disk_usage", lambda _: free)
    written: list[int] = []
    unlink = Path.unlink

    def noted(path: Path, **options: bool) -> None:
        if path.exists():
            written.append(path.stat().st_size)
        unlink(path, **options)

    monkeypatch.setattr(Path, "unlink", noted)
    folder = station.folder.path
    assert [check.status for check in check_disk(folder, 1, 5_000_000)] == ["ok"]
    assert max(written) == 5_000_000
    assert [check.status for check in check_disk(folder, 1, 5_000_001)] == ["fault"]
