"""The chain of hashes of a station: the hash of each row covers the row and the hash before it.

A program that can write to the database can also compute all hashes anew; that is detected only
with a head that was kept elsewhere.
"""

import hashlib
import heapq
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Table, bindparam, insert, select, union_all

from .schema import CHAINED

_PAGE_ROWS = 500
# The query of the last link is built only once: SQLAlchemy needs 2 ms for that, more than the
# database needs to store a result. First the last link of each table.
_LAST_LINKS = (
    select(table.c.link, table.c.chain_sha256)
    .where(table.c.station == bindparam("station"))
    .order_by(table.c.link.desc())
    .limit(1)
    .subquery()
    for table in CHAINED
)
_LAST_LINKS_OF_ALL = union_all(*map(select, _LAST_LINKS)).subquery()
_HEAD_QUERY = select(_LAST_LINKS_OF_ALL).order_by(_LAST_LINKS_OF_ALL.c.link.desc())


@dataclass(frozen=True)
class Head:
    """The last link of a chain; number 0 without rows."""

    link: int = 0
    chain_sha256: str = ""


def append(connection: Connection, table: Table, *rows: Mapping[str, Any]) -> Head:
    """Insert rows as next links of a station, and return the new head; the caller has the lock."""
    last = head(connection, rows[0]["station"])
    linked = []
    for link, row in enumerate(rows, last.link + 1):
        sha256 = _sha256(last.chain_sha256, table, {**row, "link": link})
        last = Head(link, sha256)
        linked.append({**row, **vars(last)})
    connection.execute(insert(table), linked)
    return last


def head(connection: Connection, station: str) -> Head:
    """Return the last link of a station's chain."""
    last = connection.execute(_HEAD_QUERY, {"station": station}).first()
    return Head() if last is None else Head(*last)


def has_link(connection: Connection, station: str, sha256: str) -> bool:
    """Whether a hash, such as a head that was kept elsewhere, is in the chain of a station."""
    queries = [
        select(table.c.link).where(table.c.station == station, table.c.chain_sha256 == sha256)
        for table in CHAINED
    ]
    return connection.execute(union_all(*queries)).first() is not None


def broken_links(
    reading: Callable[[], AbstractContextManager[Connection]],
    station: str,
    newest: int | None = None,
) -> Iterator[str]:
    """Yield a line for each gap in the chain, and for each row whose hash is wrong."""
    with reading() as connection:
        last = head(connection, station).link
    first = 1 if newest is None else max(1, last - newest + 1)
    before = "" if first == 1 else None  # hash of the link before; None if it was not read
    expected = first
    rows = (_rows(reading, station, table, first, last) for table in CHAINED)
    for link, table, row in heapq.merge(*rows, key=lambda entry: entry[0]):
        if link > expected:
            yield f"links {expected} to {link - 1} of the chain of hashes were deleted"
            before = None
        if before is not None and row["chain_sha256"] != _sha256(before, table, row):
            part = f", part {row['part_id']}" if row.get("part_id") else ""
            yield f"link {link} of the chain of hashes, in {table.name}{part}, was altered"
        before, expected = row["chain_sha256"], link + 1


def _rows(
    reading: Callable[[], AbstractContextManager[Connection]],
    station: str,
    table: Table,
    first: int,
    last: int,
) -> Iterator[tuple[int, Table, dict[str, Any]]]:
    """Yield rows by link, each page in a transaction of its own."""
    while True:
        page = (
            select(table)
            .where(table.c.station == station, table.c.link.between(first, last))
            .order_by(table.c.link)
            .limit(_PAGE_ROWS)
        )
        with reading() as connection:
            rows = [dict(row) for row in connection.execute(page).mappings()]
        yield from ((row["link"], table, row) for row in rows)
        if len(rows) < _PAGE_ROWS:
            return
        first = rows[-1]["link"] + 1


def _sha256(before: str, table: Table, row: Mapping[str, Any]) -> str:
    covered = {name: value for name, value in row.items() if name != "chain_sha256"}
    text = json.dumps([before, table.name, covered], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
