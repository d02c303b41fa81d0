"""Station and PLC killed in mid-handshake."""

import random
from pathlib import Path
from typing import Any

import pytest

from capture.station.domain.verdict import Cause
from tests.capture.station.line.test_handshake import (
    FAILED,
    INTERRUPTED,
    UTC,
    result,
)
from tests.evidence.station import watched_panel
from tests.evidence.station.line_kills import contradictions, killed_line
from tests.evidence.station.two_recipes import recipe_changes, rows_of, station_with_two_recipes

KILLS = 6
PASS, FAIL, ERROR = 1, 2, 4


@pytest.mark.slow
def test_no_result_is_taken_for_another_parts_when_station_and_plc_are_killed(
    tmp_path: Path,
) -> None:
    folder = station_with_two_recipes(tmp_path)
    journal = killed_line(folder, KILLS, random.Random(5)).read()
    assert list(contradictions(rows_of(folder), journal)) == []
    assert sum("result_number" in each for each in journal) >= 3
    assert recipe_changes(folder) >= 1


ROWS = {
    1: result(1, part_id="a"),
    2: result(2, FAILED, part_id="b"),
    3: result(3, INTERRUPTED, part_id="c"),
}
BEGAN = {"session": 9, "began_utc": "2027-01-01T00:00:00.000Z"}
INTERRUPTED_CODE = Cause.INTERRUPTED.plc_code


def judged(part_id: str, verdict: int, number: int | None) -> dict[str, Any]:
    return {"part_id": part_id, "verdict": verdict, "cause": 0, "number": number}


def shown(number: int, verdict: int, cause: int = 0) -> dict[str, Any]:
    return {"session": 9, "result_number": number, "verdict": verdict, "cause": cause}


@pytest.mark.parametrize(
    "journal",
    [
        [judged("a", PASS, 1), judged("b", FAIL, 2), judged("c", ERROR, 3)],
        [judged("a", ERROR, 1), judged("d", ERROR, None)],
        [BEGAN, shown(3, ERROR, INTERRUPTED_CODE)],
    ],
)
def test_an_honest_journal_has_no_contradictions(journal: list[dict[str, Any]]) -> None:
    assert list(contradictions(ROWS, journal)) == []


@pytest.mark.parametrize(
    ("journal", "said"),
    [
        ([judged("b", PASS, 1)], "has the number of a"),
        ([judged("b", PASS, 2)], "its row says FAIL"),
        ([judged("a", PASS, None)], "has no row"),
        ([judged("a", PASS, 1) | {"recipe": "sand"}], "was judged by None"),
        ([judged("a", PASS, 1), judged("a", PASS, 1)], "a was judged 2 times"),
        ([{"came": "last-0"}], "last-0 was not judged"),
        ([BEGAN, shown(1, PASS)], "it is a result of an earlier run"),
        ([BEGAN, shown(2, PASS)], "its row says FAIL"),
    ],
)
def test_a_contradiction_is_named(journal: list[dict[str, Any]], said: str) -> None:
    assert BEGAN["began_utc"] > UTC
    assert [said in each for each in contradictions(ROWS, journal)] == [True]


def event(number: int, run: str = "a", **more: Any) -> dict[str, Any]:
    return {"run": run, "event_id": number} | more


def part(number: int, part_id: str, decision: str) -> dict[str, Any]:
    return {"number": number, "part_id": part_id, "decision": decision}


def test_a_browser_that_saw_everything_or_began_anew_has_no_contradictions() -> None:
    journal = [
        {"run": "a", "snapshot": 4, "last": part(1, "a", "PASS")},
        event(5),
        event(6, shown=part(2, "b", "FAIL")),
        {"run": "b", "snapshot": 0, "last": None},
        event(1, "b"),
    ]
    assert list(watched_panel.contradictions(ROWS, journal)) == []


@pytest.mark.parametrize(
    ("journal", "said"),
    [
        ([event(1, shown=part(1, "a", "FAIL"))], "its row is"),
        ([event(1, shown=part(4, "d", "FAIL"))], "its row is None"),
        ([{"run": "a", "snapshot": 1, "last": part(1, "b", "PASS")}], "its row is"),
        ([event(n, shown=part(1, "a", "PASS")) for n in (1, 2)], "a was shown 2 times"),
        ([event(1), event(3)], "came"),
        ([event(1), event(2, "b")], "came"),
    ],
)
def test_a_browser_that_was_shown_too_little_or_something_else_is_named(
    journal: list[dict[str, Any]], said: str
) -> None:
    assert [said in each for each in watched_panel.contradictions(ROWS, journal)] == [True]
