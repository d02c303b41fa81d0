"""The log of changes: who changed what at a station, when, from which value to which."""

import uuid
from dataclasses import dataclass

from sqlalchemy import Connection, func, insert, select

from capture.base.utc_time import utc_text

from .part_result import storable
from .schema import changes
from .store import ResultStore, has_request


@dataclass(frozen=True)
class ChangeRecord:
    """A change at a station."""

    utc: str
    by: str
    role: str
    what: str  # the changed thing, such as ``user kim``
    before: str | None = None
    after: str | None = None


def record_change(
    store: ResultStore,
    what: str,
    before: str | None = None,
    after: str | None = None,
    *,
    by: str,
    role: str,
) -> None:
    """Append a change to the log, with the present time; see `ChangeRecord`."""
    utc = utc_text(timespec="milliseconds")
    row = {
        "station": store.station,
        "request": uuid.uuid4().hex,
        "utc": utc,
        "by": storable(by),
        "role": role,
        "what": storable(what),
        "before": None if before is None else storable(before),
        "after": None if after is None else storable(after),
    }

    def work(connection: Connection) -> None:
        if not has_request(connection, changes, row["request"]):
            store.lock_station(connection, utc)
            last = select(func.max(changes.c.position)).where(changes.c.station == store.station)
            position = (connection.scalar(last) or 0) + 1
            connection.execute(insert(changes).values(row | {"position": position}))

    store.write(work)


def newest_changes(store: ResultStore, count: int) -> list[ChangeRecord]:
    """Return the last changes, the newest first."""
    columns = [changes.c[name] for name in ChangeRecord.__dataclass_fields__]
    statement = (
        select(*columns)
        .where(changes.c.station == store.station)
        .order_by(changes.c.position.desc())
        .limit(count)
    )
    with store.reading() as connection:
        return [ChangeRecord(**row._mapping) for row in connection.execute(statement)]
