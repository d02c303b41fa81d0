"""Retention: remove old set files of parts that passed."""

import hashlib
import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from itertools import islice
from pathlib import Path, PurePosixPath

from capture.base.folder_lock import file_lock
from capture.base.utc_time import utc_text
from capture.station.domain.config import Retention
from capture.station.domain.folder import PARTS
from capture.station.results.removals import last_removals, passed_sets, record_removals
from capture.station.results.store import ResultStore
from classify.base.durable_file import make_folder, sync
from classify.base.errors import InputError, Ps4rigError

# Lock that is held while set files are removed, and by a backup while they must stay.
_LOCK = "sets"
# Time that a backup waits for a removal: that of a day's files takes seconds.
_TIMEOUT_S = 60.0
# Number of files in one transaction; an interrupted removal repeats at most so many.
_BATCH = 200
# Least number of days with parts whose sets stay: one that a wrong clock made, and the day before.
_MIN_DAYS = 2
# Period of removals: an hour, so that each is short.
PERIOD_S = 3600.0


def is_sample(station: str, part_id: str, pass_every: int) -> bool:
    """Whether a part that passed keeps its set file.

    The hash of its id decides, because every nth part might come from the same mould.
    """
    digest = hashlib.sha256(f"{station}/{part_id}".encode()).digest()
    return int.from_bytes(digest[:8]) % pass_every == 0


def remove_old_sets(
    folder: Path,
    store: ResultStore,
    retention: Retention,
    now: datetime,
    stop: Callable[[], bool] = lambda: False,
) -> int:
    """Remove set files that the retention does not keep, and return how many.

    They are removed in batches until `stop`; each batch is recorded before it is removed.
    """
    make_folder(folder / PARTS)
    with file_lock(folder / PARTS / _LOCK, 0.0):
        until_utc = removed_until(folder, retention, now)
        removed = _remove(folder, last_removals(store))
        to_remove = (
            (part_id, str(inside_parts(set_file)))
            for part_id, set_file in passed_sets(store, until_utc)
            if not is_sample(store.station, part_id, retention.pass_every)
        )
        while not stop() and (batch := dict(islice(to_remove, _BATCH))):
            record_removals(store, batch, _text(now))
            removed += _remove(folder, list(batch.values()))
    return removed


def removed_until(folder: Path, retention: Retention, now: datetime) -> str:
    """Return the last trigger time whose sets are removed: `Retention.pass_days` ago.

    In case the clock is wrong, the last ``pass_days / 2`` days with parts stay as well.
    """
    days = sorted((day.name for day in (folder / PARTS).glob("????-??-??/")), reverse=True)
    kept_days = days[: max(_MIN_DAYS, math.ceil(retention.pass_days / 2))]
    return min([_text(now - timedelta(days=retention.pass_days)), *kept_days])


@contextmanager
def sets_stay(folder: Path) -> Iterator[None]:
    """Keep all set files during the block; wait for a removal in progress first."""
    make_folder(folder / PARTS)
    with file_lock(folder / PARTS / _LOCK, _TIMEOUT_S):
        yield


def _remove(folder: Path, set_files: list[str]) -> int:
    """Remove the files that exist, sync their folders, and return how many were removed."""
    removed, days = 0, set()
    for set_file in set_files:
        path = folder / inside_parts(set_file)
        try:
            path.unlink()
        except FileNotFoundError:
            continue
        except OSError as error:
            raise InputError(f"{path}: cannot be removed: {error.strerror}") from error
        removed += 1
        days.add(path.parent)
    for day in days:
        sync(day)
        with suppress(OSError):  # it holds other sets
            day.rmdir()
    return removed


def inside_parts(set_file: str) -> PurePosixPath:
    """Return the path of a set file, relative to its station; InputError if outside ``parts``."""
    path = PurePosixPath(set_file)
    if path.parts[:1] != (PARTS,) or ".." in path.parts or len(path.parts) < 2:
        raise InputError(f"{set_file}: the results name it as a set, but it is not in {PARTS}/")
    return path


def _text(moment: datetime) -> str:
    return utc_text(moment, timespec="milliseconds")


@contextmanager
def retention_in_background(
    folder: Path, store: ResultStore, retention: Retention, warn: Callable[[str], None]
) -> Iterator[None]:
    """Remove old set files of a station now and every hour, until the block ends."""
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
