import dataclasses
import sqlite3
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from sqlalchemy import create_engine, text
from sqlalchemy.exc import DBAPIError

from capture.station.domain.verdict import Decision
from capture.station.results.audit import ResultsAccess, record_change
from capture.station.results.database import (
    ResultsUnavailable,
    database_url,
    postgresql_engine,
    sqlite_engine,
)
from capture.station.results.removals import record_removals
from capture.station.results.schema import VERSION
from capture.station.results.store import ResultStore, open_store
from classify.base.errors import InputError
from tests.postgresql_server import PostgresqlServer

from .conftest import OpenStore
from .parts import UTC, begin, inspect, refuse, result_of


def test_numbers_of_parts_have_no_gaps(store: ResultStore) -> None:
    numbers = [begin(store).number for _ in range(3)]
    with pytest.raises(InputError):
        begin(store, "a/b")
    assert [*numbers, begin(store).number] == [1, 2, 3, 4]


def test_threads_begin_parts_one_after_the_other(store: ResultStore) -> None:
    with ThreadPoolExecutor(8) as threads:
        begun = list(threads.map(lambda _: begin(store), range(40)))
    assert sorted(part.number for part in begun) == list(range(1, 41))


def test_each_station_of_a_database_counts_for_itself(open_line: OpenStore) -> None:
    with open_line("line-1") as one, open_line("line-2") as two:
        inspect(one, part_id="A")
        inspect(two, part_id="A")
        inspect(two)
        begin(two)
        assert [entry.result.number for entry in one.parts()] == [1]
        assert [entry.result.part_id for entry in two.parts()] == ["A", "part-000002"]
        assert (one.unfinished(), len(two.unfinished())) == ([], 1)


def test_ids_that_differ_only_in_case_would_share_a_file_and_are_refused(
    open_line: OpenStore,
) -> None:
    with open_line("line-1") as one, open_line("line-2") as two:
        begin(one, "Oak.7")
        for same in ("Oak.7", "oak.7", "OAK.7"):
            with pytest.raises(InputError, match=f"part {same}: "):
                begin(one, same)
        begin(two, "oak.7")
        assert [part.part_id for part in one.unfinished()] == ["Oak.7"]


@pytest.mark.postgresql
def test_ids_are_compared_alike_in_a_turkish_database(server: PostgresqlServer) -> None:
    # There, lower('I') is a dotless i.
    turkish = "LOCALE_PROVIDER icu ICU_LOCALE 'tr'"
    url = server.make_database("turkish", more=turkish)
    with open_store(url, "line-1", create=True) as store:
        begin(store, "LID-1")
        with pytest.raises(InputError, match=r"has had part LID-1; ids that differ"):
            begin(store, "lid-1")


@pytest.mark.parametrize(
    "part_id",
    ["", ".hidden", "a b", "../x", "x" * 101, "part-000009", "é", "nul", "Con.1", "LPT1.a.b"],
)
def test_an_id_that_cannot_name_a_part_is_refused(store: ResultStore, part_id: str) -> None:
    with pytest.raises(InputError, match="part id"):
        begin(store, part_id)
    assert store.unfinished() == []


def test_another_result_of_a_part_is_refused(store: ResultStore) -> None:
    begun = begin(store)
    store.add(result_of(begun, Decision.FAIL))
    with pytest.raises(InputError, match="another result"):
        store.add(result_of(begun, Decision.PASS))
    [entry] = store.parts()
    assert entry.decision is Decision.FAIL


def test_a_result_needs_a_begun_part_with_its_number(store: ResultStore) -> None:
    begun = begin(store)
    for wrong in ({"part_id": "never"}, {"number": 7}):
        with pytest.raises(InputError, match="not begun"):
            store.add(dataclasses.replace(result_of(begun), **wrong))
    with pytest.raises(InputError, match="line-9"):
        store.add(result_of(begun, station="line-9"))


def test_an_override_is_a_row_of_its_own_and_the_last_one_holds(store: ResultStore) -> None:
    part_id = inspect(store, Decision.FAIL).part_id
    store.override(part_id, decision=Decision.PASS, by="Kim", reason="a hair", utc=UTC)
    store.override(part_id, decision=Decision.FAIL, by="Jo", reason="no hair", utc=UTC)
    [entry] = store.parts()
    assert entry.result.verdict.decision is Decision.FAIL
    assert (entry.decision, entry.override.by) == (Decision.FAIL, "Jo")


def test_an_override_is_of_a_part_with_a_result(store: ResultStore) -> None:
    inspect(store)
    with pytest.raises(InputError, match="part-000009: station line-1 has no result of it"):
        store.override("part-000009", decision=Decision.FAIL, by="Kim", reason="dull", utc=UTC)


@pytest.mark.parametrize("wrong", [{"decision": "ERROR"}, {"reason": " "}, {"reason": "du\nll"}])
def test_an_override_has_a_verdict_and_a_reason_before_anything_is_recorded(
    store: ResultStore, wrong: dict[str, str]
) -> None:
    inspect(store)
    [entry] = store.parts()
    given = {"decision": "FAIL", "by": "Kim", "reason": "a hair"} | wrong
    with pytest.raises(InputError, match=r"PASS or FAIL|reason"):
        ResultsAccess(None).override(None, entry, **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("version", [VERSION - 1, VERSION + 1])
def test_tables_of_another_version_are_refused(
    database: str, open_line: OpenStore, version: int
) -> None:
    open_line("line-1").close()
    engine = create_engine(database_url(database))
    trigger = "DROP TRIGGER schema_versions_no_update"
    if engine.dialect.name == "postgresql":
        trigger = "DROP TRIGGER schema_versions_append_only ON schema_versions"
    with engine.begin() as other:
        other.execute(text(trigger))
        other.execute(text(f"UPDATE schema_versions SET version = {version}"))
    engine.dispose()
    for create in (True, False):
        with pytest.raises(InputError, match=f"of version {version}, and this program has version"):
            open_store(database, "line-1", create=create, exclusive=False)


TABLES = (
    "schema_versions", "stations", "begun_parts", "results", "overrides", "refused_triggers",
    "removed_sets", "changes",
)  # fmt: skip


@pytest.mark.parametrize("table", TABLES)
def test_the_database_refuses_to_change_or_delete_a_row(
    store: ResultStore, database: str, table: str
) -> None:
    part_id = inspect(store).part_id
    refuse(store)
    store.override(part_id, decision=Decision.FAIL, by="Kim", reason="dull", utc=UTC)
    record_removals(store, {part_id: "parts/x"}, UTC)
    record_change(store, "user lee", None, "operator", by="kim", role="engineer", via="page")
    url = database_url(database)
    statements = [
        f"DELETE FROM {table}",
        f"UPDATE {table} SET {COLUMN.get(table, 'station')} = '0'",
    ]
    if url.get_backend_name() == "sqlite":
        statements.append(f"INSERT OR REPLACE INTO {table} SELECT * FROM {table}")
    else:
        statements.append(f"TRUNCATE {table} CASCADE")
    engine = create_engine(url)
    for statement in statements:
        with pytest.raises(DBAPIError, match=r"never changed|such a row"), engine.begin() as other:
            other.execute(text(statement))
    engine.dispose()


COLUMN = {"schema_versions": "since_utc"}


@pytest.mark.parametrize("locked_s", [0.3, pytest.param(10.0, marks=pytest.mark.slow)])
def test_a_locked_database_is_waited_for(tmp_path: Path, locked_s: float) -> None:
    path = tmp_path / "results.sqlite"
    with open_store(str(path), "line-1", create=True) as store:
        begun = begin(store)
        other = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        other.execute("BEGIN EXCLUSIVE")
        threading.Timer(locked_s, lambda: other.execute("COMMIT")).start()
        store.add(result_of(begun))
        assert store.counters().production.parts == 1
        other.close()


@pytest.mark.postgresql
def test_a_locked_table_is_waited_for_until_it_is_unavailable(server: PostgresqlServer) -> None:
    url = server.make_database("locked")
    with (
        open_store(url, "line-1", create=True, timeout_s=2.0) as store,
        open_store(url, "line-2", create=True) as patient,
    ):
        result, of_patient = result_of(begin(store)), result_of(begin(patient), station="line-2")
        engine = create_engine(database_url(url))
        with engine.begin() as other:
            other.execute(text("LOCK TABLE results IN ACCESS EXCLUSIVE MODE"))
            waiting = threading.Thread(target=patient.add, args=(of_patient,))
            waiting.start()
            with pytest.raises(ResultsUnavailable, match="statement timeout"):
                store.add(result)
        engine.dispose()
        waiting.join()
        store.add(result)
        assert (store.unfinished(), patient.unfinished()) == ([], [])


@pytest.mark.postgresql
def test_a_reader_survives_a_restart_of_the_server(server: PostgresqlServer) -> None:
    with open_store(server.make_database("restart"), "line-1", create=True) as store:
        inspect(store)
        assert store.unfinished() == []
        server.kill()
        server.start()
        assert store.counters().production.parts == 1


def test_a_database_locked_for_longer_is_unavailable_and_loses_nothing(tmp_path: Path) -> None:
    path = tmp_path / "results.sqlite"
    with open_store(str(path), "line-1", create=True, timeout_s=0.1) as store:
        result = result_of(begin(store))
        other = sqlite3.connect(path, isolation_level=None)
        other.execute("BEGIN EXCLUSIVE")
        for call in (lambda: store.add(result), lambda: begin(store)):
            with pytest.raises(ResultsUnavailable, match=r"results\.sqlite: database is locked"):
                call()
        other.execute("COMMIT")
        other.close()
        store.add(result)
        assert (begin(store).number, store.counters().production.parts) == (2, 1)


def test_a_new_database_that_another_program_prepares_is_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "results.sqlite"
    other = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    other.execute("BEGIN IMMEDIATE")
    threading.Timer(0.3, lambda: other.execute("COMMIT")).start()
    with open_store(str(path), "line-1", create=True) as store:
        assert store.counters().production.parts == 0
    other.close()


def test_commits_of_sqlite_are_on_disk_when_they_return(tmp_path: Path) -> None:
    url = database_url(str(tmp_path / "results.sqlite"))
    with sqlite_engine(url, timeout_s=1.0, is_writer=True).connect() as connection:
        settings = "journal_mode", "synchronous", "foreign_keys"
        found = [connection.exec_driver_sql(f"PRAGMA {each}").scalar() for each in settings]
    assert found == ["wal", 2, 1]  # 2: FULL


@pytest.mark.postgresql
def test_commits_of_postgresql_are_on_disk_when_they_return(server: PostgresqlServer) -> None:
    url = database_url(server.url)
    engine = postgresql_engine(url, timeout_s=1.0, writing_station=None)
    with engine.connect() as connection:
        assert connection.exec_driver_sql("SHOW synchronous_commit").scalar() == "on"
    engine.dispose()


@pytest.mark.postgresql
def test_a_second_program_of_a_station_is_refused(server: PostgresqlServer) -> None:
    url = server.make_database("two-programs")
    with open_store(url, "line-1", create=True) as store:
        with pytest.raises(ResultsUnavailable, match="another program writes for station line-1"):
            open_store(url, "line-1", timeout_s=0.5)
        part_id = inspect(store).part_id
        with open_store(url, "line-1", exclusive=False) as beside:
            beside.override(part_id, decision=Decision.FAIL, by="Kim", reason="dull", utc=UTC)
        assert store.counters().production.verdicts == {Decision.FAIL: 1}


@pytest.mark.postgresql
def test_a_database_that_cannot_hold_every_text_is_refused(server: PostgresqlServer) -> None:
    url = server.make_database("latin", encoding="LATIN1")
    with pytest.raises(InputError, match="encoding LATIN1"):
        open_store(url, "line-1", create=True)


def test_files_that_hold_something_else_are_refused(tmp_path: Path) -> None:
    text_file = tmp_path / "a.sqlite"
    text_file.write_text("no database at all, but a text that is long enough to be one\n" * 20)
    with pytest.raises(ResultsUnavailable, match="not a database"):
        open_store(str(text_file), "line-1")
    with pytest.raises(InputError, match="no such file"):
        open_store(str(tmp_path / "b.sqlite"), "line-1")
    empty = tmp_path / "c.sqlite"
    empty.touch()
    with pytest.raises(InputError, match="holds no results"):
        open_store(str(empty), "line-1")


@pytest.mark.parametrize(
    "results", ["mysql://host/db", "postgresql://host", "sqlite:///x.sqlite", "://", "a://b:c/d"]
)
def test_another_kind_of_database_is_refused(results: str) -> None:
    with pytest.raises(InputError, match="give postgresql://"):
        open_store(results, "line-1")


@pytest.mark.parametrize(
    "results",
    [
        "postgresql://jo:secret@127.0.0.1:1/db",
        "postgresql://127.0.0.1:1/db?password=secret",
        "postgresql://127.0.0.1:1/db?sslpassword=secret",
    ],
)
def test_a_password_is_in_no_message(results: str) -> None:
    with pytest.raises(ResultsUnavailable) as caught:
        open_store(results, "line-1", timeout_s=0.0)
    assert "secret" not in str(caught.value)
