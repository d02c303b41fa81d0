"""Copies of the results while stations write to them."""

import shutil
import subprocess
import threading
from pathlib import Path
from uuid import uuid4

import pytest

from capture.station.results.removals import record_removals
from capture.station.results.snapshot import copy_results
from capture.station.results.store import ResultStore, open_store
from classify.base.errors import InputError
from tests.capture.station.results.parts import UTC, inspect
from tests.postgresql_server import PostgresqlServer


def opened_copy(database: str, copy: Path, request: pytest.FixtureRequest) -> ResultStore:
    """Open a copy; a dump is restored into another database of the server."""
    if "://" not in database:
        return open_store(str(copy), "line-1", exclusive=False)
    server: PostgresqlServer = request.getfixturevalue("server")
    url = server.make_database(f"restored-{uuid4()}")
    subprocess.run(["pg_restore", "--no-owner", f"--dbname={url}", copy], check=True, timeout=120)
    return open_store(url, "line-1", exclusive=False)


def test_a_copy_is_of_one_moment_while_a_station_writes(
    store: ResultStore, database: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    for number in range(4):
        inspect(store, set_file=f"parts/a/{number}.ome.tif")
    record_removals(store, {"part-000002": "parts/a/1.ome.tif"}, UTC)
    is_over = threading.Event()

    def produce() -> None:
        while not is_over.is_set():
            inspect(store, set_file="parts/a/more.ome.tif")

    production = threading.Thread(target=produce)
    production.start()
    try:
        copy = tmp_path / "copy"
        copy.touch()
        found = copy_results(database, "line-1", copy)
    finally:
        is_over.set()
        production.join()
    first = [f"parts/a/{number}.ome.tif" for number in (0, 2, 3)]
    assert [*found.set_files[:3]] == first
    assert found.parts == len(found.set_files) + 1 >= 4
    with opened_copy(database, copy, request) as copied:
        rows = [entry.result for entry in copied.parts()]
        assert len(rows) == found.parts
        assert rows == [entry.result for entry in store.parts()][: found.parts]
        # The copy is in use like any other database.
        inspect(copied)


def test_the_parts_of_another_station_are_not_counted(
    store: ResultStore, database: str, tmp_path: Path
) -> None:
    with open_store(database, "line-2") as other:
        inspect(store, set_file="parts/a/1.ome.tif")
        inspect(other, set_file="parts/b/1.ome.tif")
    (tmp_path / "copy").touch()
    found = copy_results(database, "line-2", tmp_path / "copy")
    assert (found.parts, found.set_files) == (1, ("parts/b/1.ome.tif",))


def test_a_damaged_sqlite_file_is_not_copied(tmp_path: Path) -> None:
    path = tmp_path / "results.sqlite"
    with open_store(str(path), "line-1", create=True) as store:
        for _ in range(20):
            inspect(store)
    content = bytearray(path.read_bytes())
    content[8192:16384] = bytes(8192)
    path.write_bytes(content)
    (tmp_path / "copy").touch()
    with pytest.raises(InputError, match=r"results.sqlite: (damaged|cannot be copied): .*"):
        copy_results(str(path), "line-1", tmp_path / "copy")


@pytest.mark.postgresql
def test_a_missing_pg_dump_is_named(
    server: PostgresqlServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(InputError, match="pg_dump is missing; install postgresql-client"):
        copy_results(server.url, "line-1", tmp_path / "copy")


@pytest.mark.postgresql
def test_a_pg_dump_that_fails_says_why(server: PostgresqlServer, tmp_path: Path) -> None:
    url = server.make_database(f"results-{uuid4()}")
    open_store(url, "line-1", create=True).close()
    with pytest.raises(InputError, match=r"pg_dump: .*nowhere"):
        copy_results(url, "line-1", tmp_path / "nowhere/copy")
