"""A copy of a database of results as it was at one moment, while stations write to it."""

import os
import shutil
import sqlite3
import subprocess
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import URL, Connection, select

from classify.base.errors import InputError

from .chain import head
from .database import TIMEOUT_S, database_url, safe_url, unavailable_if_failing
from .history import PAGE_ROWS
from .schema import removed_sets, results, same_part
from .store import open_store

# A database of a million parts has 0.5 GB and is dumped in a minute.
_DUMP_TIMEOUT_S = 3600.0


@dataclass(frozen=True)
class ResultsSnapshot:
    """Contents of a copy of the results."""

    parts: int
    set_files: tuple[str, ...]  # those that were not removed, in the order of parts
    chain_sha256: str  # head of the chain of hashes of the station


def copy_results(address: str, station: str, target: Path) -> ResultsSnapshot:
    """Copy the results as they are at one moment to an empty file.

    A copy by pg_dump also contains the results of other stations.
    """
    url = database_url(address)
    with unavailable_if_failing(url):
        if url.get_backend_name() != "sqlite":
            return _dump(address, url, station, target)
        _copy_file(Path(address), target)
        with (
            open_store(str(target), station, exclusive=False) as copy,
            copy.reading() as connection,
        ):
            return _snapshot(connection, station)


def _copy_file(path: Path, target: Path) -> None:
    try:
        with (
            closing(
                sqlite3.connect(f"{path.absolute().as_uri()}?mode=rw", TIMEOUT_S, uri=True)
            ) as source,
            closing(sqlite3.connect(target)) as copy,
        ):
            source.backup(copy)
            [answer] = copy.execute("PRAGMA integrity_check(1)").fetchone()
    except sqlite3.Error as error:
        raise InputError(f"{path}: cannot be copied: {error}") from error
    if answer != "ok":
        raise InputError(f"{path}: damaged: {answer}; restore a backup")


def _dump(address: str, url: URL, station: str, target: Path) -> ResultsSnapshot:
    program = shutil.which("pg_dump")
    if program is None:
        raise InputError(
            f"{safe_url(url)}: pg_dump is missing; install postgresql-client in the version of the "
            "server"
        )
    with open_store(address, station, exclusive=False) as store, store.reading() as connection:
        # Files and dump are of the same moment.
        connection.exec_driver_sql("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ")
        moment = connection.exec_driver_sql("SELECT pg_export_snapshot()").scalar_one()
        snapshot = _snapshot(connection, station)
        options = ("--format=custom", "--no-password", f"--snapshot={moment}", f"--file={target}")
        _run(url, (program, *options), _variables(url))
    return snapshot


def _variables(url: URL) -> dict[str, str]:
    """The address as variables of libpq, because other users can read a program's arguments."""
    variables = {
        "PGHOST": url.host,
        "PGPORT": None if url.port is None else str(url.port),
        "PGUSER": url.username,
        "PGPASSWORD": url.password,
        "PGDATABASE": url.database,
        **{f"PG{name.upper()}": str(value) for name, value in url.query.items()},
    }
    return {name: value for name, value in variables.items() if value}


def _run(url: URL, command: tuple[str, ...], variables: Mapping[str, str]) -> None:
    try:
        subprocess.run(
            command,
            env=os.environ | variables,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="backslashreplace",
            timeout=_DUMP_TIMEOUT_S,
            check=True,
        )
    except subprocess.CalledProcessError as error:
        raise InputError(f"{safe_url(url)}: pg_dump: {error.stderr.strip()}") from error
    except subprocess.TimeoutExpired as error:
        raise InputError(f"{safe_url(url)}: pg_dump took more than an hour") from error


def _snapshot(connection: Connection, station: str) -> ResultsSnapshot:
    is_stored = removed_sets.c.part_id.is_(None)
    rows = connection.execution_options(yield_per=PAGE_ROWS).execute(
        select(results.c.set_file, is_stored)
        .select_from(results.outerjoin(removed_sets, same_part(removed_sets, results)))
        .where(results.c.station == station)
        .order_by(results.c.number)
    )
    parts, files = 0, []
    for set_file, is_stored_file in rows:
        parts += 1
        if set_file is not None and is_stored_file:
            files.append(set_file)
    return ResultsSnapshot(parts, tuple(files), head(connection, station).chain_sha256)
