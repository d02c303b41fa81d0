"""Bring a database of results to the present version of its tables, forward only."""

from collections.abc import Callable, Mapping
from importlib.metadata import version

from sqlalchemy import Connection, Double, func, insert, inspect, select

from capture.base.utc_time import utc_text
from classify.base.errors import InputError

from .schema import VERSION, append_only, make_tables, schema_versions

MADE_BY = "ps4rig station run makes it while parts/ is empty; if it was lost, restore a backup"


def _add_removed_sets(connection: Connection) -> None:
    connection.exec_driver_sql(
        """
        CREATE TABLE removed_sets (
            station TEXT NOT NULL, part_id TEXT NOT NULL, batch BIGINT NOT NULL,
            utc TEXT NOT NULL, set_file TEXT NOT NULL,
            PRIMARY KEY (station, part_id),
            FOREIGN KEY (station, part_id) REFERENCES results (station, part_id)
        )
        """
    )
    keys = (("station", "part_id"),)
    for statement in append_only(connection.dialect.name, "removed_sets", keys):
        connection.exec_driver_sql(statement)


def _add_changes(connection: Connection) -> None:
    connection.exec_driver_sql(
        """
        CREATE TABLE changes (
            station TEXT NOT NULL, position BIGINT NOT NULL, request TEXT NOT NULL,
            utc TEXT NOT NULL, "by" TEXT NOT NULL, role TEXT NOT NULL, what TEXT NOT NULL,
            before TEXT, after TEXT,
            PRIMARY KEY (station, position),
            UNIQUE (request),
            FOREIGN KEY (station) REFERENCES stations (station)
        )
        """
    )
    keys = (("request",), ("station", "position"))
    for statement in append_only(connection.dialect.name, "changes", keys):
        connection.exec_driver_sql(statement)


def _add_index_without_case(connection: Connection) -> None:
    connection.exec_driver_sql(
        "CREATE INDEX begun_parts_lower ON begun_parts (station, lower(part_id))"
    )


def _make_index_independent_of_collation(connection: Connection) -> None:
    if connection.dialect.name == "postgresql":
        connection.exec_driver_sql("DROP INDEX begun_parts_lower")
        connection.exec_driver_sql(
            'CREATE INDEX begun_parts_lower ON begun_parts (station, lower(part_id COLLATE "C"))'
        )


def _add_measures_of_pieces(connection: Connection) -> None:
    kind = Double().compile(connection.dialect)
    for name in ("albedo", "scale", "handedness", "octaves", '"window"', "seam"):
        connection.exec_driver_sql(f"ALTER TABLE results ADD COLUMN {name} {kind}")


# By the version that a step leads to. A step is written once and never changed: it must not use
# the tables of `schema`, which are those of the last version.
_STEPS: Mapping[int, Callable[[Connection], None]] = {
    2: _add_removed_sets,
    3: _add_changes,
    4: _add_index_without_case,
    5: _make_index_independent_of_collation,
    6: _add_measures_of_pieces,
}


def migrate(connection: Connection, name: str, *, create: bool) -> None:
    """Make missing tables, or bring those of an earlier version forward; in one transaction.

    An empty database gets its tables only with `create`.
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
            raise InputError(f"{name}: holds no results; {MADE_BY}")
        make_tables(connection)
    for step in range(found + 1, VERSION + 1) if found else ():
        _STEPS[step](connection)
    connection.execute(
        insert(schema_versions).values(
            version=VERSION,
            since_utc=utc_text(timespec="milliseconds"),
            software_version=version("ps4rig"),
        )
    )


def stored_version(connection: Connection) -> int:
    """Return the version of the tables; 0 for a database without them."""
    if not inspect(connection).has_table(schema_versions.name):
        return 0
    return connection.scalar(select(func.max(schema_versions.c.version))) or 0
