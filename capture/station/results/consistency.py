"""Find contradictions in the results of a station, which only damage can cause."""

from collections.abc import Iterator

from sqlalchemy import func, select

from .schema import begun_parts
from .store import ResultStore


def contradictions(store: ResultStore) -> Iterator[str]:
    """Yield a line for each contradiction: missing numbers, a damaged SQLite file."""
    statement = select(func.count(), func.coalesce(func.max(begun_parts.c.number), 0)).where(
        begun_parts.c.station == store.station
    )
    with store.reading() as connection:
        count, last = connection.execute(statement).one()
        if count != last:
            yield f"{last - count} of {last} numbers of parts are missing"
        if connection.dialect.name == "sqlite":
            for (said,) in connection.exec_driver_sql("PRAGMA integrity_check"):
                if said != "ok":
                    yield said
            for table, row, parent, _ in connection.exec_driver_sql("PRAGMA foreign_key_check"):
                yield f"row {row} of {table} refers to a row of {parent} that is missing"
