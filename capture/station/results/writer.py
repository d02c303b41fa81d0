"""Transactions of one writer, repeated while a server restarts."""

import time
from collections.abc import Callable
from typing import TypeVar

from sqlalchemy import URL, Connection, Engine

from .database import ResultsUnavailable, unavailable_if_failing

_RETRY_S = 0.2  # a PostgreSQL server restarts within a second
T = TypeVar("T")


class Writer:
    """Writes to a database in transactions that are on its disk when they end."""

    def __init__(self, url: URL, engine: Engine, patience_s: float) -> None:
        self.engine = engine
        self._url = url
        self._patience_s = patience_s

    def write(self, work: Callable[[Connection], T]) -> T:
        """Do `work` in a transaction; repeat it while a PostgreSQL server cannot be reached.

        `work` must first look whether an earlier attempt was committed before its answer was lost.
        """
        last_attempt_s = time.monotonic() + self._patience_s
        while True:
            try:
                with unavailable_if_failing(self._url), self.engine.begin() as connection:
                    return work(connection)
            except ResultsUnavailable as error:
                if not error.may_pass or time.monotonic() >= last_attempt_s:
                    raise
            time.sleep(_RETRY_S)
