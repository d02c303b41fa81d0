"""The log of changes: who changed what at a station, when, from which value to which."""

import uuid
from dataclasses import dataclass

from sqlalchemy import Connection, func, insert, select

from .rows import storable
from .schema import changes
from .store import ResultStore, has_request
from .utc import require_utc


@dataclass(frozen=True)
class ChangeRecord:
    """A change at a station.

    Attributes
    ----------
    utc
        When.
    by, role
        Who, and in which role.
    what
        What was changed, such as ``user kim``.
    before, after
        The value before and after; None where there was none.
    """

    utc: str
    by: str
    role: str
    what: str
    before: str | None = None
    after: str | None = None


def record_change(store: ResultStore, change: ChangeRecord) -> None:
    """Append a change to the log.

    Raises
    ------
    ResultsUnavailable
        If the database does not answer.
    """
    row = {
        "station": store.station,
        "request": uuid.uuid4().hex,
        "utc": require_utc(change.utc),
        "by": storable(change.by),
        "role": change.role,
        "what": storable(change.what),
        "before": None if change.before is None else storable(change.before),
        "after": None if change.after is None else storable(change.after),
    }

    def work(connection: Connection) -> None:
        if not has_request(connection, changes, row["request"]):
            store.lock_station(connection, change.utc)
            last = select(func.max(changes.c.position)).where(changes.c.station == store.station)
            position = (connection.scalar(last) or 0) + 1
            connection.execute(insert(changes).values(row | {"position": position}))

    store.write(work)


def newest_changes(store: ResultStore, count: int) -> list[ChangeRecord]:
    """Return the last changes, the newest first.

    Raises
    ------
    ResultsUnavailable
        If the database does not answer.
    """
    columns = [changes.c[name] for name in ChangeRecord.__dataclass_fields__]
    statement = (
        select(*columns)
        .where(changes.c.station == store.station)
        .order_by(changes.c.position.desc())
        .limit(count)
    )
    with store.reading() as connection:
        return [ChangeRecord(**row._mapping) for row in connection.execute(statement)]
