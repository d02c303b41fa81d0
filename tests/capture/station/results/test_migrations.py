import shutil
import sqlite3
from pathlib import Path
from uuid import uuid4

import pytest
from sqlalchemy import create_engine, inspect, text

from capture.station.domain.verdict import Decision
from capture.station.results.database import database_url
from capture.station.results.removals import record_removals
from capture.station.results.schema import VERSION
from capture.station.results.store import open_store
from classify.base.errors import InputError
from tests.postgresql_server import PostgresqlServer

from .parts import UTC

# Written by the first version of the program, and not changed since.
OLD = Path(__file__).parents[3] / "data" / "results"


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.postgresql)])
def old_database(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "sqlite":
        path = tmp_path / "results.sqlite"
        shutil.copy(OLD / "version-1.sqlite", path)
        return str(path)
    server: PostgresqlServer = request.getfixturevalue("server")
    return server.make_database(f"old-{uuid4()}", OLD / "version-1.postgresql.sql")


@pytest.fixture
def new_database(request: pytest.FixtureRequest, old_database: str, tmp_path: Path) -> str:
    """An empty database of the same kind."""
    if "://" not in old_database:
        return str(tmp_path / "new.sqlite")
    server: PostgresqlServer = request.getfixturevalue("server")
    return server.make_database(f"new-{uuid4()}")


def test_a_database_of_version_1_keeps_every_row(old_database: str) -> None:
    with open_store(old_database, "line-1") as store:
        found = [
            (entry.result.number, entry.result.part_id, entry.decision) for entry in store.parts()
        ]
        assert found == [
            (1, "part-000001", Decision.PASS),
            (2, "part-000002", Decision.PASS),  # an override of FAIL
            (3, "A-17", Decision.PASS),
            (4, "part-000004", Decision.UNKNOWN),
            (5, "part-000005", Decision.PASS),
        ]
        assert [part.number for part in store.unfinished()] == [6]
        counters = store.counters()
        assert counters.production.by_station[Decision.FAIL] == 1
        assert (counters.simulated.parts, counters.production.refused_triggers) == (1, 1)
        begun = store.begin(trigger="timer", triggered_utc=UTC, simulated=False)
        assert begun.number == 7
        with pytest.raises(InputError, match="has had part A-17; ids that differ only in case"):
            store.begin(trigger="http", triggered_utc=UTC, simulated=False, part_id="a-17")
        record_removals(store, {"part-000001": "parts/x.ome.tif"}, UTC)


def columns(url: str) -> dict[str, object]:
    """Tables with their columns, keys, indexes and triggers, as the database describes them."""
    engine = create_engine(database_url(url))
    about = inspect(engine)
    found: dict[str, object] = {
        table: (
            [
                (each["name"], str(each["type"]), each["nullable"])
                for each in about.get_columns(table)
            ],
            about.get_pk_constraint(table)["constrained_columns"],
            [
                (each["constrained_columns"], each["referred_table"], each["referred_columns"])
                for each in about.get_foreign_keys(table)
            ],
        )
        for table in about.get_table_names()
    }
    names = {
        "sqlite": (
            "SELECT name, tbl_name FROM sqlite_master WHERE type IN ('trigger', 'index') ORDER BY 1"
        ),
        "postgresql": (
            "SELECT tgname, tgtype::text FROM pg_trigger WHERE NOT tgisinternal UNION "
            "SELECT indexname, indexdef FROM pg_indexes WHERE schemaname = 'public' ORDER BY 1"
        ),
    }
    with engine.connect() as connection:
        found["others"] = list(connection.execute(text(names[engine.dialect.name])))
    engine.dispose()
    return found


def test_a_migrated_database_has_the_tables_of_a_new_one(
    old_database: str, new_database: str
) -> None:
    open_store(old_database, "line-1").close()
    open_store(new_database, "line-1", create=True).close()
    assert columns(old_database) == columns(new_database)


def test_a_failed_migration_leaves_the_old_version(tmp_path: Path) -> None:
    path = tmp_path / "results.sqlite"
    shutil.copy(OLD / "version-1.sqlite", path)
    # The step makes a trigger of this name, after its table.
    with sqlite3.connect(path) as other:
        other.execute(
            "CREATE TRIGGER removed_sets_no_update BEFORE UPDATE ON stations BEGIN SELECT 1; END"
        )
    with pytest.raises(Exception, match="already exists"):
        open_store(str(path), "line-1")
    with sqlite3.connect(path) as other:
        tables = {name for (name,) in other.execute("SELECT name FROM sqlite_master")}
        assert "removed_sets" not in tables
        assert other.execute("SELECT max(version) FROM schema_versions").fetchone() == (1,)


def test_tables_of_a_later_version_are_refused(old_database: str) -> None:
    engine = create_engine(database_url(old_database))
    with engine.begin() as other:
        other.execute(text(f"INSERT INTO schema_versions VALUES ({VERSION + 1}, '{UTC}', '9.0')"))
    engine.dispose()
    with pytest.raises(InputError, match=f"of version {VERSION + 1}.*update ps4rig"):
        open_store(old_database, "line-1")
