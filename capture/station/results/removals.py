"""Rows of set files that the retention removes; the rows of their parts stay."""

from collections.abc import Iterator, Mapping
from typing import Any

from sqlalchemy import Connection, Select, func, select

from capture.station.domain.verdict import Decision

from .chain import append
from .history import PAGE_ROWS
from .part_result import require_utc
from .schema import overrides, removed_sets, results, same_part
from .store import ResultStore


def passed_sets(store: ResultStore, until_utc: str) -> Iterator[tuple[str, str]]:
    """Yield id and set file of parts that passed without override, by number.

    The parts were triggered at `until_utc` or before.
    """
    statement = (
        select(results.c.part_id, results.c.set_file)
        .outerjoin(removed_sets, same_part(removed_sets, results))
        .outerjoin(overrides, same_part(overrides, results))
        .where(
            results.c.station == store.station,
            results.c.decision == Decision.PASS.value,
            results.c.triggered_utc <= until_utc,
            results.c.set_file.is_not(None),
            removed_sets.c.part_id.is_(None),
            overrides.c.part_id.is_(None),
        )
        .order_by(results.c.number)
    )
    with store.reading() as connection:
        rows = connection.execution_options(yield_per=PAGE_ROWS).execute(statement)
        yield from ((row.part_id, row.set_file) for row in rows)


def record_removals(store: ResultStore, set_files: Mapping[str, str], utc: str) -> None:
    """Record set files (by part id) that will be removed; the caller holds the lock of sets."""
    rows = [
        {"station": store.station, "part_id": part_id, "utc": require_utc(utc), "set_file": file}
        for part_id, file in set_files.items()
    ]

    # This query takes 0.1 s with a million rows. It runs before the transaction, which blocks the
    # recording of parts.
    with store.reading() as connection:
        batch = (connection.scalar(_last_batch(store.station)) or 0) + 1

    def work(connection: Connection) -> None:
        # An earlier attempt wrote all rows or none, so one part is looked up. Queries for all parts
        # would differ by their number, and SQLite's driver would cache 128 of them, of up to 36 kB.
        is_recorded = select(removed_sets.c.part_id).where(
            removed_sets.c.station == store.station, removed_sets.c.part_id == rows[0]["part_id"]
        )
        if connection.scalar(is_recorded) is None:
            store.lock_station(connection, utc)
            append(connection, removed_sets, *(row | {"batch": batch} for row in rows))

    store.write(work)


def last_removals(store: ResultStore) -> list[str]:
    """Set files of the last transaction of `record_removals`."""
    statement = select(removed_sets.c.set_file).where(
        removed_sets.c.station == store.station,
        removed_sets.c.batch == _last_batch(store.station).scalar_subquery(),
    )
    with store.reading() as connection:
        return list(connection.scalars(statement))


def _last_batch(station: str) -> Select[Any]:
    return select(func.max(removed_sets.c.batch)).where(removed_sets.c.station == station)
