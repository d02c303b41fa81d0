"""Months of results: the history is read in pages that take no memory."""

import _sqlite3
import ctypes
import io
import time
from collections import deque
from pathlib import Path

import pytest

from capture.station.domain.verdict import Decision
from capture.station.results.chain import broken_links
from capture.station.results.history import HistoryEntry, Selection
from capture.station.results.history_table import json_pieces, write_csv
from capture.station.results.store import BegunPart, ResultStore, open_store
from tests.memory_growth import resident_mb

from .many import fill
from .parts import UTC, result_of


def sqlite_bytes() -> int:
    """Memory of all SQLite connections of this process."""
    used = ctypes.CDLL(_sqlite3.__file__).sqlite3_memory_used
    used.restype = ctypes.c_int64
    return used()


@pytest.fixture
def large_store(tmp_path: Path) -> ResultStore:
    """The results of 100,000 parts, written in one transaction."""
    store = open_store(str(tmp_path / "large.sqlite"), "line-1", create=True)
    begun = (BegunPart(f"part-{n:06d}", n, "timer", UTC, False) for n in range(1, 100_001))
    decisions = list(Decision)
    fill(store, [result_of(part, decisions[part.number % 4]) for part in begun])
    return store


@pytest.mark.slow
def test_the_history_of_100_000_parts_is_read_in_seconds_and_never_held(
    large_store: ResultStore,
) -> None:
    class Nowhere(io.StringIO):
        def write(self, text: str) -> int:
            return len(text)

    took_s = {}

    def timed(name: str, work) -> None:
        began_s = time.process_time()
        work()
        took_s[name] = time.process_time() - began_s

    timed("csv", lambda: write_csv(large_store.parts(), Nowhere()))
    counters = large_store.counters()
    pieces = json_pieces("line-1", counters, large_store.chain_head(), large_store.parts())
    timed("json", lambda: deque(pieces, maxlen=0))
    timed("chain", lambda: deque(broken_links(large_store.reading, "line-1"), maxlen=0))
    timed("counters", large_store.counters)
    timed("last 50", lambda: list(large_store.parts(newest=50)))
    failed = Selection(decision=Decision.FAIL)
    timed("FAIL", lambda: deque[HistoryEntry](large_store.parts(failed), maxlen=0))
    before_mb = most_mb = resident_mb()
    for entry in large_store.parts():
        if entry.result.number % 5000 == 0:
            most_mb = max(most_mb, resident_mb())
    large_store.close()
    figures = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in took_s.items())
    print(f"\n100,000 parts, CPU time: {figures}; memory +{most_mb - before_mb:.1f} MB")
    assert most_mb - before_mb < 10.0
    assert counters.production.station_verdicts == dict.fromkeys(Decision, 25_000)


@pytest.mark.slow
def test_a_reader_of_a_large_table_keeps_few_of_its_pages(large_store: ResultStore) -> None:
    before = sqlite_bytes()
    deque(large_store.parts(), maxlen=0)
    assert sqlite_bytes() - before < 0.5e6
    large_store.close()
