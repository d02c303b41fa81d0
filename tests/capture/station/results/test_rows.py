import dataclasses
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.station.domain.verdict import Cause, Decision, Verdict
from capture.station.results.part_result import (
    MAX_TEXT,
    MEASURES,
    DefectRecord,
    PartResult,
    result_of,
    storable,
)
from capture.station.results.store import ResultStore, open_store
from tests.postgresql_server import PostgresqlServer

from .parts import UTC, begin, minimal

# What every database takes; the rest becomes an escape sequence.
texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=60)
names = st.none() | texts
numbers = st.floats(allow_nan=False, allow_infinity=False)
integers = st.integers(-(2**70), 2**70)  # in JSON, where nothing bounds them
defects = st.builds(
    DefectRecord, texts, integers, integers, integers, integers, integers, score=numbers
)
verdicts = st.builds(
    lambda causes, decision, reason: Verdict(decision if causes else Decision.PASS, reason, causes),
    st.lists(st.sampled_from(Cause), max_size=4).map(tuple),
    st.sampled_from(list(Decision)[1:]),
    texts,
)
results = st.builds(
    PartResult,
    station=st.just("line-1"),
    part_id=st.just("part-000001"),
    number=st.integers(1, 2**63 - 1),
    trigger=texts,
    triggered_utc=st.datetimes().map(lambda t: f"{t.isoformat(timespec='milliseconds')}Z"),
    exposed_utc=st.sampled_from([None, UTC]),
    decided_utc=st.just(UTC),
    verdict=verdicts,
    operator=names,
    simulated=st.booleans(),
    software_version=texts,
    recipe=names,
    recipe_version=st.none() | st.integers(-(2**63) + 1, 2**63 - 1),
    recipe_sha256=names,
    library_sha256=names,
    calibration_sha256=names,
    set_file=names,
    set_sha256=names,
    label=names,
    nearest=names,
    **dict.fromkeys(MEASURES, st.none() | numbers),
    defects=st.lists(defects, max_size=3).map(tuple),
    led_levels=st.lists(numbers, max_size=4).map(tuple),
    timings_ms=st.dictionaries(texts, numbers, max_size=3),
    notes=st.lists(texts, max_size=3).map(tuple),
)


@given(results)
def test_a_result_comes_back_from_its_row(result: PartResult) -> None:
    assert result_of(result.row) == result


def comes_back(store: ResultStore, result: PartResult) -> None:
    begun = begin(store)
    result = dataclasses.replace(result, part_id=begun.part_id, number=begun.number)
    store.add(result)
    store.add(result)
    [entry] = store.parts(newest=1)
    assert entry.result == result


@pytest.fixture(scope="module")
def sqlite_store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ResultStore]:
    path: Path = tmp_path_factory.mktemp("results") / "results.sqlite"
    with open_store(str(path), "line-1", create=True) as store:
        yield store


@settings(max_examples=40)  # each one is on disk twice
@given(result=results)
def test_a_result_comes_back_from_sqlite(sqlite_store: ResultStore, result: PartResult) -> None:
    comes_back(sqlite_store, result)


@pytest.fixture(scope="module")
def postgresql_store(server: PostgresqlServer) -> Iterator[ResultStore]:
    with open_store(server.make_database("rows"), "line-1", create=True) as store:
        yield store


@pytest.mark.postgresql
@given(result=results)
def test_a_result_comes_back_from_postgresql(
    postgresql_store: ResultStore, result: PartResult
) -> None:
    comes_back(postgresql_store, result)


@given(st.text(st.characters(), max_size=3 * MAX_TEXT))
def test_every_text_becomes_one_that_a_database_takes(text: str) -> None:
    stored = storable(text)
    assert stored.encode("utf-8").decode("utf-8") == stored
    assert "\0" not in stored
    assert len(stored) <= MAX_TEXT
    assert storable(stored) == stored


@pytest.mark.parametrize(
    ("text", "stored"),
    [("a\0b", "a\\x00b"), ("\udcff.tif", "\\udcff.tif"), ("x" * 3000, "x" * 1999 + "…")],
)
def test_texts_of_other_programs_are_escaped_and_bounded(text: str, stored: str) -> None:
    assert storable(text) == stored


@pytest.mark.parametrize(
    "wrong",
    [
        *({name: value} for name in ("distance", "sdq") for value in (float("nan"), float("inf"))),
        {"led_levels": (1.0, float("nan"))},
        {"timings_ms": {"solve": float("nan")}},
        {"defects": (DefectRecord("relief", 1, 2, 3, 4, 5, float("nan")),)},
        {"number": 0},
        {"number": 2**63},
        {"recipe_version": 2**64},
        {"decided_utc": "2026-11-22T17:08:13Z"},
        {"triggered_utc": "2026-11-22 17:08:13.042"},
    ],
)
def test_a_value_that_no_row_can_hold_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"nan|inf|number|not a time"):
        minimal(**wrong)
