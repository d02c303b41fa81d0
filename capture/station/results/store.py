"""`ResultStore`: begun parts, their results and overrides, and rows of other tables."""

import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self, TypeVar

from sqlalchemy import URL, Connection, Engine, Row, Select, Table, func, insert, select
from sqlalchemy.exc import IntegrityError

from capture.station.domain.verdict import Decision
from classify.base.errors import InputError

from .chain import Head, append, head
from .database import (
    TIMEOUT_S,
    ResultsUnavailable,
    database_url,
    postgresql_engine,
    safe_url,
    sqlite_engine,
    unavailable_if_failing,
)
from .history import (
    EVERY_PART,
    Counters,
    HistoryEntry,
    Selection,
    counters_of,
    entries,
    part_groups,
)
from .part_result import (
    PartResult,
    generated_part_id,
    require_given_part_id,
    require_utc,
    result_of,
    storable,
)
from .schema import (
    HOW_TO_MAKE,
    begun_parts,
    lower_ascii,
    make_tables,
    overrides,
    require_tables,
    results,
    same_part,
    stations,
)

_RETRY_S = 0.2  # a PostgreSQL server restarts within a second
_T = TypeVar("_T")


@dataclass(frozen=True)
class BegunPart:
    """A part whose trigger was accepted; each gets exactly one result."""

    part_id: str
    number: int
    trigger: str
    triggered_utc: str
    simulated: bool


AppendRemotely = Callable[[str, list[dict[str, Any]], str | None], bool]
"""Lets another process append rows like `ResultStore.append_rows`; False if no process does."""


class ResultStore:
    """Results of one station, from `open_store`. Thread-safe.

    Each method that writes makes one transaction on disk. `add` may be repeated.
    """

    def __init__(
        self, url: URL, station: str, writer: Engine, reader: Engine, timeout_s: float
    ) -> None:
        self.url, self.station, self._timeout_s = url, station, timeout_s
        self._writer, self._reader = writer, reader
        self.append_remotely: AppendRemotely = lambda *_: False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all connections."""
        self._writer.dispose()
        self._reader.dispose()

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """Yield a connection for queries; errors of the database are `ResultsUnavailable`."""
        with unavailable_if_failing(self.url), self._reader.connect() as connection:
            yield connection

    def write(self, work: Callable[[Connection], _T]) -> _T:
        """Do `work` in a transaction on disk, and repeat it while PostgreSQL is unreachable.

        `work` must therefore look whether an earlier attempt was committed.
        """
        last_attempt_s = time.monotonic() + self._timeout_s
        while True:
            try:
                with unavailable_if_failing(self.url), self._writer.begin() as connection:
                    return work(connection)
            except ResultsUnavailable as error:
                if not error.is_transient or time.monotonic() >= last_attempt_s:
                    raise
            time.sleep(_RETRY_S)

    def begin(
        self, *, trigger: str, triggered_utc: str, simulated: bool, part_id: str | None = None,
        require: Callable[[], None] = lambda: None,
    ) -> BegunPart:  # fmt: skip
        """Record an accepted trigger before the first exposure, and give the part its number.

        `require` is called under the lock of the station; if it raises, no row is written. After
        `ResultsUnavailable` the row may have been written: then `unfinished` lists the part.
        """
        if part_id is not None:
            require_given_part_id(part_id)
        require_utc(triggered_utc)
        request = uuid.uuid4().hex

        def work(connection: Connection) -> BegunPart:
            written = connection.execute(_BEGUN.where(begun_parts.c.request == request)).first()
            if written is not None:
                return _begun_part(written)
            self.lock_station(connection, triggered_utc)
            require()
            if part_id is not None:
                _require_new_part_id(connection, self.station, part_id)
            number = self._last(connection, begun_parts.c.number) + 1
            part = BegunPart(
                part_id or generated_part_id(number),
                number,
                storable(trigger),
                triggered_utc,
                simulated,
            )
            row = {"station": self.station, "request": request, **vars(part)}
            connection.execute(insert(begun_parts).values(row))
            return part

        return self.write(work)

    def add(self, result: PartResult) -> PartResult:
        """Record the result of a begun part, once; return it with its place in the chain."""
        row = result.row
        if result.station != self.station:
            raise InputError(f"station {self.station} cannot hold a result of {result.station}")

        def work(connection: Connection) -> PartResult:
            self.lock_station(connection, result.decided_utc)
            written = self._find(connection, results, result.part_id)
            if written is None:
                return replace(result, **vars(append(connection, results, row)))
            recorded = result_of(dict(written._mapping))
            if recorded != result_of(row):
                raise InputError(f"part {result.part_id}: has another result already")
            return recorded

        try:
            return self.write(work)
        except IntegrityError as error:
            raise InputError(f"part {result.part_id}, number {result.number}: not begun") from error

    def override(self, part_id: str, *, decision: Decision, by: str, reason: str, utc: str) -> None:
        """Record that a person gives a part another verdict; the result stays unchanged."""
        row = {"part_id": part_id, "utc": utc, "decision": decision.value, "by": by}
        self.append(overrides, row | {"reason": reason.strip()}, of_part=part_id)

    def append(self, table: Table, *rows: Mapping[str, Any], of_part: str | None = None) -> None:
        """Append rows; `position` numbers them within the station, or within the part `of_part`."""
        new_rows = [
            {"station": self.station, "request": uuid.uuid4().hex}
            | {key: storable(cell) if isinstance(cell, str) else cell for key, cell in row.items()}
            for row in rows
        ]
        if not self.append_remotely(table.name, new_rows, of_part):
            self.append_rows(table.name, new_rows, of_part)

    def append_rows(self, name: str, new_rows: list[dict[str, Any]], of_part: str | None) -> None:
        """Append rows with their ``request``, by which a repeated call finds them; see `append`."""
        table = begun_parts.metadata.tables[name]
        utc = require_utc(new_rows[0]["utc"])

        def work(connection: Connection) -> None:
            # An earlier attempt may have been committed before its answer was lost.
            written = select(table.c.request).where(table.c.request == new_rows[0]["request"])
            if connection.execute(written).first() is not None:
                return
            self.lock_station(connection, utc)
            if of_part is not None and self._find(connection, results, of_part) is None:
                raise InputError(f"part {of_part}: station {self.station} has no result of it")
            within = {} if of_part is None else {"part_id": of_part}
            last = self._last(connection, table.c.position, **within)
            numbered = [row | {"position": last + n} for n, row in enumerate(new_rows, 1)]
            append(connection, table, *numbered)

        self.write(work)

    def check_writable(self, utc: str) -> None:
        """Write a row and roll it back; ResultsUnavailable if it cannot be written."""
        row = {"station": f"self-test {uuid.uuid4().hex}", "since_utc": utc}

        def work(connection: Connection) -> None:
            # The transaction is committed: a rollback of all of it would write nothing to the disk.
            with connection.begin_nested() as savepoint:
                connection.execute(insert(stations).values(row))
                savepoint.rollback()

        self.write(work)

    def last_number(self) -> int:
        """Return the number of the latest part that this station has begun, 0 without any."""
        with self.reading() as connection:
            return self._last(connection, begun_parts.c.number)

    def unfinished(self) -> list[BegunPart]:
        """Parts without a result, by number: after a kill or a loss of power."""
        statement = (
            _BEGUN.outerjoin(results, same_part(results, begun_parts))
            .where(begun_parts.c.station == self.station, results.c.part_id.is_(None))
            .order_by(begun_parts.c.number)
        )
        with self.reading() as connection:
            return [_begun_part(row) for row in connection.execute(statement)]

    def known_ids(self, part_ids: Iterable[str]) -> set[str]:
        """Return the ids among `part_ids` that belong to parts of this station."""
        column, texts = begun_parts.c.part_id, [storable(part_id) for part_id in part_ids]
        statement = select(column).where(begun_parts.c.station == self.station, column.in_(texts))
        with self.reading() as connection:
            return set(connection.scalars(statement))

    def parts(
        self, selection: Selection = EVERY_PART, *, newest: int | None = None
    ) -> Iterator[HistoryEntry]:
        """Yield selected parts by number, with last override and removed set, in pages.

        Parts that are added meanwhile are left out.
        """
        return entries(self.reading, self.station, selection, newest)

    def part(self, part_id: str) -> HistoryEntry | None:
        """Return one part; None if there is no result of it."""
        return next(self.parts(Selection(part_id=part_id)), None)

    def counters(self, selection: Selection = EVERY_PART) -> Counters:
        """Count the selected parts; those of a simulated rig are counted separately."""
        with self.reading() as connection:
            groups = part_groups(connection, self.station, selection)
            return counters_of(connection, self.station, selection, groups)

    def chain_head(self) -> Head:
        """Return the last link of the chain of hashes."""
        with self.reading() as connection:
            return head(connection, self.station)

    def lock_station(self, connection: Connection, utc: str) -> None:
        """Lock the numbers of this station until the end of a transaction; on SQLite all rows."""
        row = select(stations).where(stations.c.station == self.station)
        if connection.execute(row.with_for_update()).first() is None:
            connection.execute(insert(stations).values(station=self.station, since_utc=utc))

    def _find(self, connection: Connection, table: Table, part_id: str) -> Row[Any] | None:
        return connection.execute(
            select(table).where(table.c.station == self.station, table.c.part_id == part_id)
        ).first()

    def _last(self, connection: Connection, column: Any, **values: str) -> int:
        """Return the highest value of a column that counts rows of this station; 0 without rows."""
        table = column.table
        conditions = [table.c[name] == value for name, value in values.items()]
        statement = select(func.max(column)).where(table.c.station == self.station, *conditions)
        return connection.scalar(statement) or 0


_BEGUN: Select[Any] = select(
    *(begun_parts.c[name] for name in BegunPart.__dataclass_fields__)
).select_from(begun_parts)


def _begun_part(row: Row[Any]) -> BegunPart:
    return BegunPart(**row._mapping)


def _require_new_part_id(connection: Connection, station: str, part_id: str) -> None:
    """Check that a station has not had a part with this id, in upper or lower case."""
    known = connection.scalar(
        select(begun_parts.c.part_id)
        .where(begun_parts.c.station == station)
        .where(lower_ascii(begun_parts.c.part_id) == part_id.lower())
        .order_by(begun_parts.c.part_id != part_id)
    )
    if known == part_id:
        raise InputError(f"part {part_id}: this station has had a part with this id")
    if known is not None:
        raise InputError(
            f"part {part_id}: this station has had part {known}; ids that differ only in case "
            "would name the same file on some systems"
        )


def open_store(
    results: str, station: str, *, create: bool = False, exclusive: bool = True,
    timeout_s: float = TIMEOUT_S,
) -> ResultStore:  # fmt: skip
    """Open the results of a station.

    `create` makes missing tables. `exclusive` refuses a second program that writes.
    """
    url = database_url(results)
    if url.get_backend_name() == "sqlite":
        if not create and not Path(results).is_file():
            raise InputError(f"{results}: no such file; {HOW_TO_MAKE}")
        writer = sqlite_engine(url, timeout_s=timeout_s, is_writer=True)
        reader = sqlite_engine(url, timeout_s=timeout_s, is_writer=False)
    else:
        name = station if exclusive else None
        writer = postgresql_engine(url, timeout_s=timeout_s, writing_station=name)
        reader = postgresql_engine(url, timeout_s=timeout_s, writing_station=None)
    store = ResultStore(url, station, writer, reader, timeout_s)
    try:
        if create:
            store.write(lambda connection: make_tables(connection, safe_url(url)))
        elif exclusive:  # the connection that writes takes the lock of the station
            store.write(lambda connection: require_tables(connection, safe_url(url)))
        else:  # a program that only reads may have no permission to write
            with store.reading() as connection:
                require_tables(connection, safe_url(url))
    except BaseException:
        store.close()
        raise
    return store
