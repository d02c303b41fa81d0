"""The removal of old set files while a station runs."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from classify.errors import Ps4rigError

from .config import Retention
from .events import Event, Warned
from .results.store import ResultStore
from .retention import remove_old_sets

# A fast line writes 200 sets of 10 MB in this time: 2 GB more than the retention says.
_PERIOD_S = 600.0


@contextmanager
def housekeeping(
    folder: Path, store: ResultStore, retention: Retention, publish: Callable[[Event], None]
) -> Iterator[None]:
    """Remove set files that the retention does not keep, at once and every ten minutes.

    It runs in a thread beside the block. What fails is a warning, and is tried again.
    """
    ended = threading.Event()

    def work() -> None:
        while True:
            try:
                remove_old_sets(folder, store, retention, datetime.now(UTC))
            except Ps4rigError as error:
                publish(Warned(f"old sets were not removed: {error}"))
            if ended.wait(_PERIOD_S):
                return

    thread = threading.Thread(target=work, name="station housekeeping")
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
