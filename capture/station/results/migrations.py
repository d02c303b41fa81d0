"""Bring a database of results to the present version of its tables, forward only."""

from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from importlib.metadata import version

from sqlalchemy import Connection, func, insert, inspect, select

from classify.errors import InputError

from .schema import VERSION, make_tables, schema_versions
from .utc import utc_text

# By the version that a step leads to. A step is written once and never changed: it must not use
# the tables of `schema`, which are those of the last version.
_STEPS: Mapping[int, Callable[[Connection], None]] = {}


def migrate(connection: Connection, name: str, *, create: bool) -> None:
    """Make missing tables, or bring those of an earlier version forward; in one transaction.

    Parameters
    ----------
    connection
        Inside a transaction that may write.
    name
        What messages call the database.
    create
        Whether an empty database gets its tables.

    Raises
    ------
    InputError
        If it holds no results and must not be made, or is of a later version.
    """
    if connection.dialect.name == "postgresql":
        # Stations that start at the same moment take turns.
        connection.exec_driver_sql("SELECT pg_advisory_xact_lock(0, hashtext('ps4rig'))")
    found = stored_version(connection)
    if found == VERSION:
        return
    if found > VERSION:
        raise InputError(
            f"{name}: its tables are of version {found}, and this program knows {VERSION}; "
            "update ps4rig"
        )
    if found == 0:
        if not create:
            raise InputError(f"{name}: holds no results of a station; ps4rig station init makes it")
        make_tables(connection)
    for step in range(found + 1, VERSION + 1) if found else ():
        _STEPS[step](connection)
    connection.execute(
        insert(schema_versions).values(
            version=VERSION,
            since_utc=utc_text(datetime.now(UTC)),
            software_version=version("ps4rig"),
        )
    )


def stored_version(connection: Connection) -> int:
    """Return the version of the tables; 0 for a database without them."""
    if not inspect(connection).has_table(schema_versions.name):
        return 0
    return connection.scalar(select(func.max(schema_versions.c.version))) or 0
