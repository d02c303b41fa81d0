"""Databases of results: an SQLite file, and a database of a PostgreSQL server."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from uuid import uuid4

import pytest

from capture.station.results.store import ResultStore, open_store
from tests.postgresql_server import PostgresqlServer, postgresql_server


@pytest.fixture(scope="session")
def server() -> Iterator[PostgresqlServer]:
    with postgresql_server() as server:
        yield server


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.postgresql)])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An empty database, as `open_store` takes it."""
    if request.param == "sqlite":
        return str(tmp_path / "results.sqlite")
    server: PostgresqlServer = request.getfixturevalue("server")
    return server.make_database(f"results-{uuid4()}")


OpenStore = Callable[..., ResultStore]


@pytest.fixture
def open_line(database: str) -> OpenStore:
    """Opens the results of a station in `database`, by its name."""
    return partial(open_store, database, create=True)


@pytest.fixture
def store(open_line: OpenStore) -> Iterator[ResultStore]:
    with open_line("line-1") as store:
        yield store
