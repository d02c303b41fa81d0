"""Time and memory of reading months of results, which are never held as a whole.

python -m tests.evidence.station.history --parts 1000000
"""

import _sqlite3
import argparse
import ctypes
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Sequence
from itertools import cycle
from pathlib import Path

from capture.station.domain.verdict import Decision
from capture.station.results.chain import broken_links
from capture.station.results.history import Selection, csv_pieces, json_pieces
from capture.station.results.store import BegunPart, ResultStore, open_store
from tests.capture.station.results.many import fill
from tests.capture.station.results.parts import UTC, result_of
from tests.evidence.limits import at_most
from tests.memory_growth import resident_mb

_DECISIONS = tuple(Decision)
# Parts that are held and written together. The memory of all parts, once freed, would hide that a
# reader holds them.
_AT_ONCE = 1000


def _sqlite_mb() -> float:
    """Memory of all SQLite connections of this process."""
    used = ctypes.CDLL(_sqlite3.__file__).sqlite3_memory_used
    used.restype = ctypes.c_int64
    return float(used()) / 1e6


def _measured(store: ResultStore, parts: int) -> bool:
    def used_up(pieces: object) -> None:
        deque(pieces, maxlen=0)  # type: ignore[call-overload]

    # The first read of all parts: memory that an earlier one has freed would hide theirs.
    before_mb = most_mb = resident_mb()
    sqlite_mb = _sqlite_mb()
    for entry in store.parts():
        if entry.result.number % 5000 == 0:
            most_mb = max(most_mb, resident_mb())
    kept_mb = _sqlite_mb() - sqlite_mb
    counters, failed = store.counters(), Selection(decision=Decision.FAIL)
    works: dict[str, Callable[[], object]] = {
        "csv": lambda: used_up(csv_pieces(store.parts())),
        "json": lambda: used_up(json_pieces("line-1", counters, store.chain_head(), store.parts())),
        "chain": lambda: used_up(broken_links(store.reading, "line-1")),
        "counters": store.counters,
        "last 50": lambda: used_up(store.parts(newest=50)),
        "FAIL": lambda: used_up(store.parts(failed)),
    }
    for name, work in works.items():
        began_s = time.process_time()
        work()
        print(f"{name:44} {time.process_time() - began_s:9.4g} s of processor time")
    wrong = sum(
        abs(counters.production.station_verdicts[each] - parts // len(_DECISIONS))
        for each in _DECISIONS
    )
    are_met = [
        at_most("MB of pages that a reader keeps", kept_mb, 0.5),
        at_most("MB while all parts are read", most_mb - before_mb, 10.0),
        at_most("parts that the counters miss or double", wrong, 0),
    ]
    return all(are_met)


def main(arguments: Sequence[str]) -> int:
    """Print the table; return 1 if a figure is beyond its limit."""
    parser = argparse.ArgumentParser(prog="history")
    parser.add_argument("--parts", type=int, default=1_000_000)
    parser.add_argument("--quick", action="store_true", help="20,000 parts, which take 16 MB")
    given = parser.parse_args(arguments)
    parts = 20_000 if given.quick else given.parts // _AT_ONCE * _AT_ONCE
    with (
        tempfile.TemporaryDirectory(prefix="ps4rig-history-") as folder,
        open_store(str(Path(folder) / "large.sqlite"), "line-1", create=True) as store,
    ):
        for first in range(1, parts + 1, _AT_ONCE):
            numbers = range(first, first + _AT_ONCE)
            begun = (BegunPart(f"part-{n:06d}", n, "timer", UTC, False) for n in numbers)
            verdicts = zip(begun, cycle(_DECISIONS))
            fill(store, [result_of(each, decision) for each, decision in verdicts])
        return int(not _measured(store, parts))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
