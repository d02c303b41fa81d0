"""Rows that somebody alters or deletes in the database itself break the chain of hashes."""

from collections.abc import Callable

import pytest
from sqlalchemy import create_engine, delete, text, update

from capture.station.domain.verdict import Decision
from capture.station.results.audit import record_change
from capture.station.results.chain import Head, broken_links
from capture.station.results.removals import record_removals
from capture.station.results.schema import CHAINED, changes, overrides, results
from capture.station.results.store import ResultStore

from .parts import UTC, begin, inspect, refuse, result_of


@pytest.fixture
def filled(store: ResultStore) -> ResultStore:
    """Results, links 1 and 2, and one row of each other table, 3 to 6."""
    inspect(store, Decision.UNKNOWN, distance=-0.0, defects=(), timings_ms={"b": 1.0, "a": 1e-7})
    inspect(store)
    store.override("part-000001", decision=Decision.PASS, by="Kim", reason="a hair", utc=UTC)
    refuse(store)
    record_removals(store, {"part-000002": "parts/x.ome.tif"}, UTC)
    record_change(store, "user kim", by="Jo", role="engineer", via="page")
    return store


def broken(store: ResultStore, newest: int | None = None) -> list[str]:
    return list(broken_links(store.reading, store.station, newest))


def tamper(store: ResultStore, *statements: object) -> None:
    """Do what somebody with access to the database can do."""
    engine = create_engine(store.url)
    with engine.begin() as connection:
        for table in CHAINED:
            if engine.dialect.name == "sqlite":
                for event in ("update", "delete"):
                    connection.execute(text(f"DROP TRIGGER {table.name}_no_{event}"))
            else:
                connection.execute(text(f"DROP TRIGGER {table.name}_append_only ON {table.name}"))
        for statement in statements:
            connection.execute(statement)
    engine.dispose()


def test_the_chain_of_an_unaltered_station_is_whole(filled: ResultStore) -> None:
    assert broken(filled) == []
    assert broken(filled, newest=2) == []
    assert filled.chain_head().link == 6


def test_each_result_names_its_link(store: ResultStore) -> None:
    assert store.chain_head() == Head(0, "")
    begun = result_of(begin(store))
    recorded = store.add(begun)
    assert store.add(begun).chain_sha256 == recorded.chain_sha256
    assert store.chain_head() == Head(1, recorded.chain_sha256)
    [entry] = store.parts()
    assert (entry.result.link, entry.result.chain_sha256) == (1, recorded.chain_sha256)


def test_an_altered_verdict_is_found(filled: ResultStore) -> None:
    tamper(filled, update(results).where(results.c.number == 1).values(decision="PASS"))
    [line] = broken(filled)
    assert line.startswith("link 1 of the chain of hashes, in results, part part-000001")


def test_a_deleted_override_and_a_deleted_change_are_found(filled: ResultStore) -> None:
    record_change(filled, "user lee", by="Jo", role="engineer", via="page")
    tamper(filled, delete(overrides), delete(changes).where(changes.c.position == 1))
    assert broken(filled) == [
        "links 3 to 3 of the chain of hashes were deleted",
        "links 6 to 6 of the chain of hashes were deleted",
    ]


def test_each_station_has_a_chain(
    filled: ResultStore, open_line: Callable[..., ResultStore]
) -> None:
    with open_line("line-2") as other:
        inspect(other)
        inspect(filled)
        assert [other.chain_head().link, filled.chain_head().link] == [1, 7]
        assert broken(other) == broken(filled) == []
