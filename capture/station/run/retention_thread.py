"""Removal of old set files beside a running station."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from capture.station.domain.config import Retention
from capture.station.results.store import ResultStore
from classify.base.errors import Ps4rigError

from .retention import remove_old_sets

# Sets reach their age hour by hour, so one removal is short.
PERIOD_S = 3600.0


@contextmanager
def retention_in_background(
    folder: Path, store: ResultStore, retention: Retention, warn: Callable[[str], None]
) -> Iterator[None]:
    """Remove old set files of a station now and every hour, until the block ends.

    A failure is passed to `warn` and tried again an hour later.
    """
    ended = threading.Event()

    def keep_removing() -> None:
        while True:
            try:
                remove_old_sets(folder, store, retention, datetime.now(UTC), stop=ended.is_set)
            except (Ps4rigError, OSError) as error:  # OSError: the disk cannot sync
                warn(f"old sets are not removed: {error}")
            if ended.wait(PERIOD_S):
                return

    thread = threading.Thread(target=keep_removing, name="station retention")
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
