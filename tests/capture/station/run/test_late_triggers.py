"""A trigger that was waited for too long exposes nothing, and is on record as refused."""

import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.domain.verdict import Cause, Decision
from capture.station.results.store import BegunPart
from capture.station.run.cycle import Station
from capture.station.run.events import PartAnnounced, PartRecovered, TriggerRefused
from capture.station.run.refusals import MAX_WAITING
from capture.station.run.station_clock import StationClock
from capture.station.run.triggers import Accepted, Answer, Refusal, Refused, Trigger
from tests.capture.station.stations import Bench, Manual, bench, one_after_the_other, until_ready

LIMIT_S, LATER_S = 0.1, 60.0


@pytest.fixture
def station(tmp_path: Path, captured: CapturedSet) -> Iterator[Bench]:
    with bench(tmp_path / "line-1", captured) as made:
        yield made


@contextmanager
def locked(station: Bench) -> Iterator[None]:
    """Hold a lock on the database, as another program may."""
    database = station.folder.results
    with closing(sqlite3.connect(database, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        yield
        other.execute("ROLLBACK")


def refused_triggers(station: Bench) -> int:
    return station.store.counters().simulated.refused_triggers


def test_a_trigger_that_a_locked_database_holds_up_is_refused_in_time(station: Bench) -> None:
    """Triggers age with a clock that the test sets: a busy machine makes none of them late."""
    answers, now_s = list[Answer](), [time.monotonic()]
    station.clock = StationClock(monotonic_s=lambda: now_s[0])

    def feed(target: Station) -> None:
        def submit() -> None:
            answers.append(target.submit(Trigger("http", at_s=now_s[0])))

        until_ready(target)
        with locked(station):
            submit()
            # Another one, while the first is still in the database's queue.
            submit()
            assert refused_triggers(station) == 0
        now_s[0] += 2 * LATER_S
        target._beginning._max_age_s = LATER_S
        until_ready(target)
        submit()

    station.run(Manual(feed), count=1, max_trigger_age_s=LIMIT_S)
    assert isinstance(answers[0], Refused)
    assert answers[0].kind is Refusal.DATABASE
    assert f"no answer in {LIMIT_S:g} s" in answers[0].reason  # it would be waited for 20 s
    assert isinstance(answers[1], Refused)
    assert isinstance(answers[2], Accepted)
    # Nothing was exposed but for the last one; both refusals were stored later.
    assert [event.result.verdict.decision for event in station.of(PartAnnounced)] == [Decision.PASS]
    assert [event.recorded for event in station.of(TriggerRefused)] == [True, True]
    assert refused_triggers(station) == 2


def test_a_trigger_that_is_too_old_when_the_row_is_written_is_refused(station: Bench) -> None:
    answers: list[Answer] = []

    def feed(target: Station) -> None:
        until_ready(target)
        answers.append(target.submit(Trigger("modbus", at_s=time.monotonic() - 2 * LATER_S)))
        answers.append(target.submit(Trigger("modbus")))

    station.run(Manual(feed), max_trigger_age_s=LATER_S)
    assert isinstance(answers[0], Refused)
    assert answers[0].kind is Refusal.LATE
    assert isinstance(answers[1], Accepted)
    assert station.of(PartRecovered) == []


def test_a_begun_part_is_not_exposed_when_its_trigger_is_too_old(station: Bench) -> None:
    """The last look at the age is just before the exposure."""
    exposed: list[int] = []
    station.camera.on_capture = exposed.append
    late_s, begin = [0.0], station.store.begin
    station.clock = StationClock(monotonic_s=lambda: time.monotonic() + late_s[0])

    def slow(**given: Any) -> BegunPart:
        begun = begin(**given)
        late_s[0] = 120.0
        return begun

    station.store.begin = slow  # type: ignore[method-assign]
    station.run(one_after_the_other(1), count=1)
    [result] = [event.result for event in station.of(PartAnnounced)]
    assert result.verdict.decision is Decision.ERROR
    assert result.verdict.causes == (Cause.CAPTURE,)
    assert exposed == []


def test_a_flood_of_refused_triggers_is_counted_in_few_rows(station: Bench) -> None:
    def feed(target: Station) -> None:
        until_ready(target)
        with locked(station):
            for _ in range(MAX_WAITING + 57):
                trigger = Trigger("modbus", "A-1\n\x1b[2J\ud800" + 60_000 * "x")
                target.refuse(trigger, Refused("busy"))

    station.run(Manual(feed))
    events = station.of(TriggerRefused)
    assert MAX_WAITING < len(events) <= MAX_WAITING + 2
    assert refused_triggers(station) == len(events)
    assert all(len(event.part_id or "") <= 200 for event in events)
    assert all((event.part_id or "x").isprintable() for event in events)
    assert sum(event.triggers for event in events) == MAX_WAITING + 57
