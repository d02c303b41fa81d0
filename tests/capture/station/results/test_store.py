from pathlib import Path

import pytest

from capture.station.results.database import results_url
from capture.station.results.part_result import PartResult
from capture.station.results.store import BegunPart, ResultStore, open_store
from capture.station.verdict import Decision, Verdict
from classify.errors import InputError

UTC = "2026-11-22T17:08:13.042Z"


@pytest.fixture
def store(tmp_path: Path) -> ResultStore:
    with open_store(results_url("results.sqlite", tmp_path), "line-1", create=True) as store:
        yield store


def begin(store: ResultStore, part_id: str | None = None) -> BegunPart:
    return store.begin(trigger="timer", triggered_utc=UTC, simulated=False, part_id=part_id)


def result_of(begun: BegunPart, station: str = "line-1") -> PartResult:
    return PartResult(
        station=station,
        **vars(begun),
        exposed_utc=UTC,
        decided_utc=UTC,
        verdict=Verdict(Decision.PASS, "like oak"),
        operator=None,
        software_version="0.1.0",
    )


def test_numbers_of_parts_have_no_gaps(store: ResultStore) -> None:
    assert [begin(store).number for _ in range(5)] == [1, 2, 3, 4, 5]


def test_a_part_id_is_given_once(store: ResultStore) -> None:
    begin(store, "oak.7")
    with pytest.raises(InputError, match=r"oak\.7"):
        begin(store, "oak.7")


def test_a_begun_part_is_unfinished_until_it_has_its_result(store: ResultStore) -> None:
    first, second = begin(store), begin(store)
    store.add(result_of(first))
    store.add(result_of(first))
    assert store.unfinished() == [second]
