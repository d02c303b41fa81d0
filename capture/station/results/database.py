"""Connections to the database of results: SQLite in a file, or a PostgreSQL server."""

import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from sqlalchemy import URL, Connection, Engine, QueuePool, create_engine, event, make_url
from sqlalchemy.exc import (
    ArgumentError,
    DBAPIError,
    IntegrityError,
    InterfaceError,
    OperationalError,
)
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

from capture.station.domain.verdict import Cause
from classify.base.errors import InputError, Ps4rigError

# Default time for which a call waits for a locked database.
TIMEOUT_S = 20.0
_CONNECT_TIMEOUT_S = 5
_PAUSE_S = 0.01  # between two attempts to switch the journal of a new SQLite file
# Cache of an SQLite connection that only reads. A scan of a table would fill and keep SQLite's
# default of 2 MB. Queries are as fast with this size (`python -m tests.evidence.station.history`).
_READ_CACHE_KB = 256
_RESULTS_FORM = "give postgresql://USER@HOST/DATABASE, or a file name such as results.sqlite"
# Advisory locks of PostgreSQL are named by two integers: the letters "ps4r", and the station.
_LOCK_CLASS = 0x70733472


class ResultsUnavailable(Ps4rigError):  # noqa: N818 - the state of a server, not a fault in a call
    """The database does not answer or cannot be written.

    The call was written completely or not at all, and may be repeated.
    """

    exit_status = 3
    cause, device = Cause.STORAGE, "database"

    def __init__(self, message: str, *, is_transient: bool = False) -> None:
        super().__init__(message)
        self.is_transient = is_transient


def database_url(results: str) -> URL:
    """Return the address of ``postgresql://USER@HOST/DATABASE`` or of an SQLite file."""
    if "://" not in results:
        return URL.create("sqlite", database=results)
    try:
        url = make_url(results)
    except (ArgumentError, ValueError) as error:
        kind = results.partition("://")[0]
        raise InputError(f"results = {kind}://...: {_RESULTS_FORM}") from error
    if url.drivername not in ("postgresql", "postgresql+psycopg") or not url.database:
        raise InputError(f"results = {safe_url(url)}: {_RESULTS_FORM}")
    return url.set(drivername="postgresql+psycopg")


def safe_url(url: URL) -> str:
    """Return an address without its passwords, for messages."""
    if url.get_backend_name() == "sqlite":
        return str(url.database)
    hidden = {name: "***" for name in url.query if "pass" in name.lower()}
    return url.update_query_dict(hidden).render_as_string()


def sqlite_engine(url: URL, *, timeout_s: float, is_writer: bool) -> Engine:
    """Return connections to SQLite whose commits are on disk.

    Each transaction of a writer takes the lock at its beginning.
    """
    engine = create_engine(
        url,
        poolclass=QueuePool,
        pool_size=1 if is_writer else 5,
        max_overflow=0 if is_writer else 10,
        pool_timeout=timeout_s,
        connect_args={"timeout": timeout_s, "check_same_thread": False},
    )

    @event.listens_for(engine, "connect")
    def _prepare(connection: sqlite3.Connection, _record: Any) -> None:
        # Python's own transactions would not include CREATE TABLE; `_begin` begins them instead.
        connection.isolation_level = None
        _use_write_ahead_log(connection, timeout_s)
        for pragma in ("synchronous = FULL", "foreign_keys = ON"):
            connection.execute(f"PRAGMA {pragma}")
        if not is_writer:
            connection.execute(f"PRAGMA cache_size = -{_READ_CACHE_KB}")

    @event.listens_for(engine, "begin")
    def _begin(connection: Connection) -> None:
        connection.exec_driver_sql("BEGIN IMMEDIATE" if is_writer else "BEGIN")

    return engine


def _use_write_ahead_log(connection: sqlite3.Connection, timeout_s: float) -> None:
    """Switch to the write-ahead log.

    SQLite's time-out does not apply if two programs make the file at the same time.
    """
    deadline_s = time.monotonic() + timeout_s
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
            return
        except sqlite3.OperationalError as error:
            is_locked = error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_BUSY
            if not is_locked or time.monotonic() > deadline_s:
                raise
        time.sleep(_PAUSE_S)


def postgresql_engine(url: URL, *, timeout_s: float, writing_station: str | None) -> Engine:
    """Return connections whose commits wait for the server's disk.

    A connection for `writing_station` takes the lock against a second writer.
    """
    timeout_ms = max(1, round(timeout_s * 1000))  # 0 would be no limit
    settings = f"-c synchronous_commit=on -c statement_timeout={timeout_ms}"
    try:
        engine = create_engine(
            url,
            poolclass=QueuePool,
            pool_size=1 if writing_station else 5,
            max_overflow=0 if writing_station else 10,
            pool_timeout=timeout_s,
            pool_pre_ping=writing_station is None,  # a writer repeats its transactions itself
            connect_args={
                "connect_timeout": _CONNECT_TIMEOUT_S,
                "options": settings,
                # A server that vanished without closing is noticed after 5 + 3 * 5 s.
                "keepalives_idle": 5,
                "keepalives_interval": 5,
                "keepalives_count": 3,
                "tcp_user_timeout": timeout_ms,
                "application_name": f"ps4rig {writing_station or 'reader'}"[:63],
            },
        )
    except ModuleNotFoundError as error:
        raise InputError(
            f"{safe_url(url)}: needs the driver of PostgreSQL; pip install 'ps4rig[postgresql]'"
        ) from error

    @event.listens_for(engine, "connect")
    def _prepare(connection: Any, _record: Any) -> None:
        try:
            with connection.cursor() as cursor:
                _require_utf8(cursor, url)
                if writing_station is not None:
                    _lock_for(cursor, url, writing_station)
            connection.commit()
        except BaseException:
            connection.close()
            raise

    return engine


def _require_utf8(cursor: Any, url: URL) -> None:
    encoding = cursor.execute("SHOW server_encoding").fetchone()[0]
    if encoding != "UTF8":
        raise InputError(
            f"{safe_url(url)}: the database has the encoding {encoding}, which cannot hold every "
            "text; make one with UTF8"
        )


def _lock_for(cursor: Any, url: URL, station: str) -> None:
    lock = "SELECT pg_try_advisory_lock(%s, hashtext(%s))"
    [is_free] = cursor.execute(lock, (_LOCK_CLASS, station)).fetchone()
    if not is_free:
        raise ResultsUnavailable(
            f"{safe_url(url)}: another program writes for station {station}; end it, or give this "
            "station another name",
            is_transient=True,
        )


@contextmanager
def unavailable_if_failing(url: URL) -> Iterator[None]:
    """Turn errors of the database into `ResultsUnavailable`; an `IntegrityError` stays."""
    try:
        yield
    except IntegrityError:
        raise
    except (DBAPIError, PoolTimeoutError) as error:
        message = " ".join(str(error.orig if isinstance(error, DBAPIError) else error).split())
        is_lost = isinstance(error, OperationalError | InterfaceError)
        raise ResultsUnavailable(
            f"{safe_url(url)}: {message or type(error).__name__}",
            is_transient=is_lost and url.get_backend_name() == "postgresql",
        ) from error
