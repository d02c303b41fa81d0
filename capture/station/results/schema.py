"""The tables of the results, for SQLite and PostgreSQL; rows are only ever appended.

A change of a table needs a new `VERSION`; a database of another version is refused.
"""

from collections.abc import Iterator
from importlib.metadata import version
from types import UnionType
from typing import Any, get_args

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    ColumnElement,
    Connection,
    Double,
    ForeignKey,
    ForeignKeyConstraint,
    FromClause,
    Index,
    Integer,
    MetaData,
    PrimaryKeyConstraint,
    Table,
    Text,
    UniqueConstraint,
    and_,
    func,
    insert,
    inspect,
    select,
)
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import GenericFunction

from capture.base.utc_time import utc_text
from classify.base.errors import InputError

from .part_result import COLUMNS

VERSION = 10
HOW_TO_MAKE = "ps4rig station run makes it while parts/ is empty; if it was lost, restore a backup"

_metadata = MetaData()
_LINK = ("link", "chain_sha256")
_TYPES: dict[object, Any] = {str: Text, int: BigInteger, bool: Boolean, float: Double}


def _column(name: str, kind: Any) -> Column[Any]:
    """The column of a field of `PartResult`: JSON if it is neither a text nor a number."""
    [kind, *optional] = get_args(kind) if isinstance(kind, UnionType) else [kind]
    kind = str if isinstance(kind, type) and issubclass(kind, str) else kind
    return Column(name, _TYPES.get(kind, JSON), nullable=bool(optional))


def _texts(*names: str) -> Iterator[Column[Any]]:
    yield from (Column(name, Text, nullable=False) for name in names)


def _request() -> Column[Any]:
    """A random key by which a program finds out, after a lost connection, if it wrote the row."""
    return Column("request", Text, nullable=False, unique=True)


def _link() -> Iterator[Column[Any] | UniqueConstraint]:
    """Columns of a row in the chain of hashes of its station; `chain.append` fills them."""
    yield Column("link", BigInteger, nullable=False)
    yield Column("chain_sha256", Text, nullable=False)
    yield UniqueConstraint("station", "link")


class lower_ascii(GenericFunction[str]):  # noqa: N801 - a function of SQL
    """A text with A to Z in lower case; ``lower('I')`` differs in a Turkish PostgreSQL database."""

    type = Text()
    inherit_cache = True


@compiles(lower_ascii)
def _lower(element: lower_ascii, compiler: SQLCompiler, **options: Any) -> str:
    return f"lower({compiler.process(element.clauses, **options)})"


@compiles(lower_ascii, "postgresql")
def _lower_in_postgresql(element: lower_ascii, compiler: SQLCompiler, **options: Any) -> str:
    return f'lower({compiler.process(element.clauses, **options)} COLLATE "C")'


# The version of the tables, the time at which they were made and the program that made them.
_schema_versions = Table(
    "schema_versions",
    _metadata,
    Column("version", Integer, primary_key=True, autoincrement=False),
    *_texts("since_utc", "software_version"),
)

stations = Table(
    "stations",
    _metadata,
    Column("station", Text, primary_key=True),
    *_texts("since_utc"),
)

# One row for each accepted trigger, written before the first exposure.
begun_parts = Table(
    "begun_parts",
    _metadata,
    Column("station", Text, ForeignKey("stations.station"), nullable=False),
    *_texts("part_id"),
    Column("number", BigInteger, nullable=False),
    _request(),
    *_texts("trigger", "triggered_utc"),
    Column("simulated", Boolean, nullable=False),
    PrimaryKeyConstraint("station", "part_id"),
    UniqueConstraint("station", "number"),
    UniqueConstraint("station", "part_id", "number"),
)
Index("begun_parts_lower", begun_parts.c.station, lower_ascii(begun_parts.c.part_id))

# The fields of `PartResult`, in its words.
results = Table(
    "results",
    _metadata,
    *(_column(name, kind) for name, kind in COLUMNS.items() if name not in _LINK),
    *_link(),
    PrimaryKeyConstraint("station", "part_id"),
    UniqueConstraint("station", "number"),
    ForeignKeyConstraint(
        ("station", "part_id", "number"),
        ("begun_parts.station", "begun_parts.part_id", "begun_parts.number"),
    ),
)

# A person's verdict on a part that has a result; the one with the highest position holds.
overrides = Table(
    "overrides",
    _metadata,
    *_texts("station", "part_id"),
    Column("position", BigInteger, nullable=False),
    _request(),
    *_texts("utc", "decision", "by", "reason"),
    *_link(),
    PrimaryKeyConstraint("station", "part_id", "position"),
    ForeignKeyConstraint(("station", "part_id"), ("results.station", "results.part_id")),
)

# Triggers that could not be served.
refused_triggers = Table(
    "refused_triggers",
    _metadata,
    Column("station", Text, ForeignKey("stations.station"), nullable=False),
    Column("position", BigInteger, nullable=False),
    _request(),
    *_texts("utc", "trigger"),
    Column("part_id", Text),
    *_texts("reason"),
    Column("simulated", Boolean, nullable=False),
    *_link(),
    PrimaryKeyConstraint("station", "position"),
)

# Set files that the retention removes. A batch is one transaction, written before its files are
# removed: after an interruption, files of the last batch may still exist.
removed_sets = Table(
    "removed_sets",
    _metadata,
    *_texts("station", "part_id"),
    Column("batch", BigInteger, nullable=False),
    *_texts("utc", "set_file"),
    *_link(),
    PrimaryKeyConstraint("station", "part_id"),
    ForeignKeyConstraint(("station", "part_id"), ("results.station", "results.part_id")),
)

# What people and programs changed at the station, other than verdicts.
changes = Table(
    "changes",
    _metadata,
    Column("station", Text, ForeignKey("stations.station"), nullable=False),
    Column("position", BigInteger, nullable=False),
    _request(),
    *_texts("utc", "by", "role", "via", "what"),
    Column("before", Text),
    Column("after", Text),
    *_link(),
    PrimaryKeyConstraint("station", "position"),
)

CHAINED = (results, overrides, refused_triggers, removed_sets, changes)
"""The tables whose rows are in the chain of hashes."""


def same_part(table: FromClause, other: FromClause) -> ColumnElement[bool]:
    """Return the condition that rows of two tables are of the same part."""
    return and_(table.c.station == other.c.station, table.c.part_id == other.c.part_id)


def require_tables(connection: Connection, name: str) -> None:
    """Check that the tables are of this version."""
    stored_version = _stored_version(connection)
    if stored_version == 0:
        raise InputError(f"{name}: holds no results; {HOW_TO_MAKE}")
    if stored_version != VERSION:
        raise InputError(
            f"{name}: its tables are of version {stored_version}, and this program has version "
            f"{VERSION}; use the ps4rig that made them, or begin a new database"
        )


def make_tables(connection: Connection, name: str) -> None:
    """Make all tables in an empty database, with triggers that protect rows, or check them."""
    if connection.dialect.name == "postgresql":
        # Stations that start at the same moment take turns.
        connection.exec_driver_sql("SELECT pg_advisory_xact_lock(0, hashtext('ps4rig'))")
    if _stored_version(connection) != 0:
        require_tables(connection, name)
        return
    _metadata.create_all(connection, checkfirst=False)
    if connection.dialect.name == "postgresql":
        connection.exec_driver_sql(_POSTGRESQL_REFUSAL)
    for table in _metadata.sorted_tables:
        for statement in _append_only(connection.dialect.name, table.name, _keys(table)):
            connection.exec_driver_sql(statement)
    row = {
        "version": VERSION,
        "since_utc": utc_text(timespec="milliseconds"),
        "software_version": version("ps4rig"),
    }
    connection.execute(insert(_schema_versions).values(row))


def _stored_version(connection: Connection) -> int:
    """Return the version of the tables; 0 for a database without them."""
    if not inspect(connection).has_table(_schema_versions.name):
        return 0
    return connection.scalar(select(func.max(_schema_versions.c.version))) or 0


def _append_only(dialect: str, table: str, keys: tuple[tuple[str, ...], ...]) -> Iterator[str]:
    """Statements that prevent changes of a table.

    SQLite fires no such trigger for ``INSERT OR REPLACE``: another one refuses used unique `keys`.
    """
    if dialect == "postgresql":
        yield (
            f"CREATE TRIGGER {table}_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON {table} "
            "FOR EACH STATEMENT EXECUTE FUNCTION ps4rig_append_only()"
        )
        return
    refusal = f"SELECT RAISE(ABORT, '{table}: rows are never changed or deleted')"
    for event in ("UPDATE", "DELETE"):
        yield (
            f"CREATE TRIGGER {table}_no_{event.lower()} BEFORE {event} ON {table} "
            f"BEGIN {refusal}; END"
        )
    has_used_key = " OR ".join(
        "(" + " AND ".join(f"{column} = NEW.{column}" for column in key) + ")" for key in keys
    )
    yield (
        f"CREATE TRIGGER {table}_no_replace BEFORE INSERT ON {table} "
        f"WHEN EXISTS (SELECT 1 FROM {table} WHERE {has_used_key}) "
        f"BEGIN SELECT RAISE(ABORT, '{table}: there is such a row already'); END"
    )


_POSTGRESQL_REFUSAL = """
CREATE FUNCTION ps4rig_append_only() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    RAISE EXCEPTION USING MESSAGE = TG_TABLE_NAME || ': rows are never changed or deleted';
END $$
"""


def _keys(table: Table) -> tuple[tuple[str, ...], ...]:
    return tuple(
        sorted(
            tuple(column.name for column in constraint.columns)
            for constraint in table.constraints
            if isinstance(constraint, PrimaryKeyConstraint | UniqueConstraint)
        )
    )
