"""Figures over many parts, against the same counted one by one."""

from collections import Counter
from collections.abc import Sequence
from datetime import UTC, timedelta, timezone, tzinfo
from typing import Any

from sqlalchemy import Row

from capture.station.domain.verdict import Cause, Decision, Verdict
from capture.station.results.history import Selection
from capture.station.results.part_result import DefectRecord
from capture.station.results.statistics import (
    MAX_PERIODS,
    Period,
    count_parts,
    counted_causes,
    counted_defects,
    counted_periods,
    known_names,
    newest_measured,
)
from capture.station.results.store import ResultStore

from .many import fill, many
from .parts import inspect

PRODUCTION = Selection(simulated=False)


def groups_of(store: ResultStore, selection: Selection = PRODUCTION) -> Sequence[Row[Any]]:
    return count_parts(store, selection)[1]


def periods_of(store: ResultStore, zone: tzinfo, selection: Selection = PRODUCTION) -> list[Period]:
    return counted_periods(groups_of(store, selection), zone)


def test_counts_are_those_of_the_parts_one_by_one(store: ResultStore) -> None:
    fill(store, many("line-1", 900, simulated=30))
    for each in [each for each in store.parts() if each.result.verdict.decision == "FAIL"][:3]:
        store.override(
            each.result.part_id, decision=Decision.PASS, by="Kim", reason="a hair",
            utc=each.result.decided_utc,
        )  # fmt: skip
    selected = Selection(simulated=False, since_utc="2026-11-22T18:00:00.000Z", label="rock")
    entries = list(store.parts(selected))
    assert 500 < len(entries) < 720
    hours = Counter((each.result.triggered_utc[:13], each.decision) for each in entries)
    assert {
        (period.begin, decision): parts
        for period in periods_of(store, UTC, selected)
        for decision, parts in period.verdicts.items()
    } == hours
    entries = list(store.parts(PRODUCTION))
    causes = [each.result.verdict.causes for each in entries if each.result.verdict.causes]
    found = counted_causes(groups_of(store))
    assert {each.cause: each.parts for each in found} == {
        cause: sum(each[0] == cause for each in causes) for cause in {c for e in causes for c in e}
    }
    assert {each.cause: each.after_graver for each in found if each.after_graver} == {
        Cause.DEFECT: sum(Cause.DEFECT in each[1:] for each in causes)
    }
    assert [each.parts for each in found] == sorted((each.parts for each in found), reverse=True)


def test_collected_parts_have_no_share_in_yield_and_causes(store: ResultStore) -> None:
    collected = Verdict(Decision.UNKNOWN, "collected", (Cause.COLLECTED,))
    inspect(store)
    inspect(store, Decision.UNKNOWN, verdict=collected)
    tally = store.counters().production
    assert (tally.parts, tally.collected, tally.verdicts) == (1, 1, {Decision.PASS: 1})
    [period] = periods_of(store, UTC)
    assert period.verdicts == {Decision.PASS: 1}
    assert counted_causes(groups_of(store)) == []


def test_kinds_of_defects_count_apart_from_causes(store: ResultStore) -> None:
    verdict = Verdict(Decision.UNKNOWN, "unknown, a defect", (Cause.NO_TEXTURE, Cause.DEFECT))
    seam = DefectRecord("seam", 1, 2, 3, 4, 5, 1.5)
    for kind in ("relief", "albedo", "relief"):
        defects = (DefectRecord(kind, 1, 2, 3, 4, 5, 2.5), seam)
        inspect(store, Decision.UNKNOWN, verdict=verdict, defects=defects)
    inspect(store, Decision.UNKNOWN)
    foreign = (Cause.NO_TEXTURE, Cause.BLUR, Cause.DEFECT, Cause.OCTAVES)
    inspect(store, Decision.UNKNOWN, verdict=Verdict(Decision.UNKNOWN, "sand", foreign))
    found = [
        (each.cause, each.parts, each.after_graver) for each in counted_causes(groups_of(store))
    ]
    assert found[:2] == [(Cause.DEFECT, 3, 1), (Cause.NO_TEXTURE, 2, 3)]
    assert found[2:] == [(Cause.BLUR, 0, 1), (Cause.OCTAVES, 0, 1)]
    kinds = [(each.cause, each.parts) for each in counted_defects(store, PRODUCTION)]
    assert kinds == [("relief", 2), ("albedo", 1)]


def test_the_charts_are_of_the_last_parts_that_matched_a_texture(store: ResultStore) -> None:
    fill(store, many("line-1", 300, simulated=30))
    matched = [each.result for each in store.parts(PRODUCTION) if each.result.label is not None]
    found = newest_measured(store, PRODUCTION, max_count=100)
    assert [each.number for each in found] == [each.number for each in matched[-100:]]
    assert found[-1].distance == matched[-1].distance
    assert tuple(found[-1].led_levels) == matched[-1].led_levels


def test_periods_are_hours_days_or_months_by_their_span(store: ResultStore) -> None:
    def at(utc: str) -> list[str]:
        inspect(store, triggered_utc=f"{utc}:00.000Z")
        return [period.begin for period in periods_of(store, UTC)]

    assert periods_of(store, UTC) == []
    assert at("2026-11-22T17:08") == ["2026-11-22T17"]
    assert at("2026-11-23T17:08") == ["2026-11-22T17", "2026-11-23T17"]
    assert at("2026-12-01T00:00") == ["2026-11-22", "2026-11-23", "2026-12-01"]
    assert at("2027-05-01T00:00") == ["2026-11", "2026-12", "2027-05"]


def test_periods_are_of_a_zone(store: ResultStore) -> None:
    east = timezone(timedelta(hours=9))
    inspect(store, triggered_utc="2026-11-22T17:08:00.000Z")
    assert [each.begin for each in periods_of(store, east)] == ["2026-11-23T02"]
    inspect(store, triggered_utc="2026-11-30T17:08:00.000Z")
    days = periods_of(store, east)
    assert [(each.begin, each.parts) for each in days] == [("2026-11-23", 1), ("2026-12-01", 1)]


def test_periods_begin_where_those_of_a_zone_with_half_hours_do(store: ResultStore) -> None:
    kathmandu = timezone(timedelta(hours=5, minutes=45))
    for minute in ("14", "15", "59"):
        inspect(store, triggered_utc=f"2026-11-22T18:{minute}:59.999Z")
    hours = periods_of(store, kathmandu)
    assert [(each.begin, each.parts) for each in hours] == [
        ("2026-11-22T23", 1),
        ("2026-11-23T00", 2),
    ]


def test_a_clock_that_jumps_leaves_the_answer_bounded(store: ResultStore) -> None:
    parts = many("line-1", 500)
    for number, part in enumerate(parts):
        utc = f"{1500 + number:04d}-01-01T00:00:00.000Z"
        object.__setattr__(part, "triggered_utc", utc)
    fill(store, parts)
    found = periods_of(store, UTC)
    assert len(found) == MAX_PERIODS
    assert found[-1].begin == "1999-01"


def test_names_for_a_form_are_those_of_the_parts(store: ResultStore) -> None:
    assert known_names(store) == ((), ())
    inspect(store, label="sand", recipe="b")
    inspect(store, label="rock", recipe="b")
    verdict = Verdict(Decision.ERROR, "LED 2 at 31 %", (Cause.CAPTURE,))
    inspect(store, Decision.ERROR, verdict=verdict)
    assert known_names(store) == (("rock", "sand"), ("b",))
