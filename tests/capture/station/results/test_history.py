"""The history is read in pages, whatever a client asks for and however slowly it reads."""

from pathlib import Path

import pytest
from sqlalchemy import text

from capture.station.results.history import PAGE_ROWS, Selection
from capture.station.results.store import ResultStore, open_store

from .many import fill, many
from .parts import inspect


def test_a_slow_reader_keeps_no_transaction(tmp_path: Path) -> None:
    """SQLite empties its log into the file only when nobody reads what is before it."""
    with open_store(str(tmp_path / "results.sqlite"), "line-1", create=True) as store:
        fill(store, many("line-1", 2 * PAGE_ROWS))
        entries = store.parts()
        next(entries)
        inspect(store)
        with store.reading() as connection:
            connection.execute(text("ROLLBACK"))
            checkpoint = "PRAGMA wal_checkpoint(TRUNCATE)"
            is_busy, _, _ = connection.execute(text(checkpoint)).one()
            connection.execute(text("BEGIN"))
        assert is_busy == 0
        assert len(list(entries)) == 2 * PAGE_ROWS - 1


@pytest.mark.parametrize("count", [0, 1, PAGE_ROWS, 2 * PAGE_ROWS + 1])
def test_all_pages_together_have_every_part_once(tmp_path: Path, count: int) -> None:
    with open_store(str(tmp_path / "results.sqlite"), "line-1", create=True) as store:
        if count:
            fill(store, many("line-1", count))
        numbers = [entry.result.number for entry in store.parts()]
        assert numbers == list(range(1, count + 1))
        newest = [entry.result.number for entry in store.parts(newest=3)]
        assert newest == numbers[-3:]
        labelled = [each.result.number for each in store.parts(Selection(label="sand"))]
        assert all(number % 5 == 0 for number in labelled)
        below = [each.result.number for each in store.parts(Selection(below_number=700))]
        assert below == numbers[:699]


@pytest.mark.parametrize(
    "value", ["a\0b", "\0", "\ud800", "\u202e", 10_000 * "x", "' OR 1=1 --", ""]
)
def test_what_no_database_can_hold_selects_nothing(store: ResultStore, value: str) -> None:
    inspect(store)
    names = ("part_id", "id_contains", "label", "recipe")
    for selection in (
        Selection(**{name: value}) for name in names if value or name != "id_contains"
    ):
        assert list(store.parts(selection)) == []
        assert store.counters(selection).production.parts == 0
    assert store.known_ids([value]) == set()


@pytest.mark.parametrize(("text", "found"), [("a-1", ["A-1", "xa-17"]), ("%", []), ("_", ["b_2"])])
def test_parts_are_found_by_a_part_of_their_id(
    store: ResultStore, text: str, found: list[str]
) -> None:
    for part_id in ("A-1", "xa-17", "b_2"):
        inspect(store, part_id=part_id)
    entries = store.parts(Selection(id_contains=text))
    assert [each.result.part_id for each in entries] == found
