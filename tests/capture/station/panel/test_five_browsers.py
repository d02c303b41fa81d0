"""Five browsers on the operator's page of a station that judges part after part.

``PARTS`` is the number of parts with the browsers, and as many without, half of them before and
half after; ``FRAME_PX`` is the side of their images. Parts are triggered as fast as the station
takes them. The browsers stand for panel computers, but draw five pages with the two cores that
judge the parts: with the policy SCHED_IDLE they use what the station leaves.
"""

import os
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from capture.station.bench import BenchResult, run_bench
from capture.station.cycle.events import Event, PartAnnounced
from capture.station.folder import StationFolder, make_station
from capture.station.live.live_station import LiveStation
from capture.station.panel.panel import Panel
from capture.station.panel.server import serving_panel
from tests.capture.station.panel.panels import ANY_PORT
from tests.chromium import Page, chromium

PARTS = int(os.environ.get("PARTS", "20"))
FRAME_PX = int(os.environ.get("FRAME_PX", "256"))
BROWSERS, CLASSES = 5, 30


@dataclass(frozen=True)
class Watched:
    """A run with browsers.

    Attributes
    ----------
    bench
        What the bench measured.
    used_ms
        Processor time of the station and its panel for each part.
    early_mb, late_mb
        The heap of each page after a tenth of the parts, and at the end.
    """

    bench: BenchResult
    used_ms: float
    early_mb: list[float]
    late_mb: list[float]


def heap_mb(page: Page) -> float:
    """Memory of the page's scripts, without what nobody needs any more."""
    page.call("HeapProfiler.collectGarbage")
    return float(page.call("Runtime.getHeapUsage")["usedSize"]) / 1e6


def watched(folder: Path, parts: int, browsers: int) -> Watched:
    """Judge parts while browsers show the operator's page."""
    make_station(folder)
    live, is_early = LiveStation("bench", simulated=True), threading.Event()
    found: list[BenchResult] = []
    used_s: list[float] = []

    def count_parts(event: Event) -> None:
        if isinstance(event, PartAnnounced):
            used_s.append(time.process_time())
            if len(used_s) == parts // 10:
                is_early.set()

    def judge() -> None:
        try:
            found.append(
                run_bench(folder, parts, FRAME_PX, CLASSES, subscribers=(live.tell, count_parts))
            )
        finally:
            is_early.set()

    with ExitStack() as stack:
        panel = Panel.of(StationFolder(folder), live, ANY_PORT)
        url = stack.enter_context(serving_panel(panel))
        pages = []
        if browsers:
            browser = stack.enter_context(chromium(folder.parent / "profile", is_elsewhere=True))
            pages = [browser.page(url, alone=True) for _ in range(browsers)]
            for page in pages:
                page.call("HeapProfiler.enable")
        judging = threading.Thread(target=judge)
        judging.start()
        is_early.wait()
        early_mb = [heap_mb(page) for page in pages]
        judging.join()
        (bench,) = found
        for page in pages:
            last = live.snapshot().last
            assert last is not None
            page.until(f"document.getElementById('part').textContent == '{last.part_id}'")
            shown = [
                int(page.text(f"count-{name}")) for name in ("PASS", "FAIL", "UNKNOWN", "ERROR")
            ]
            assert sum(shown) == parts
            # The bench keeps the last sets only; pictures of the others cannot be made.
            assert [each for each in page.errors() if "/pictures" not in each] == []
        used_ms = 1e3 * (used_s[-1] - used_s[0]) / (parts - 1)
        return Watched(bench, used_ms, early_mb, [heap_mb(page) for page in pages])


@pytest.mark.browser
def test_browsers_see_every_part_and_cost_no_memory(tmp_path: Path) -> None:
    before = watched(tmp_path / "before" / "bench", PARTS // 2, 0)
    seen = watched(tmp_path / "seen" / "bench", PARTS, BROWSERS)
    after = watched(tmp_path / "after" / "bench", PARTS // 2, 0)
    without_ms = np.array([*before.bench.latencies_ms, *after.bench.latencies_ms])
    with_ms = np.array(seen.bench.latencies_ms)
    for percent in (50, 99):
        alone_ms, open_ms = (np.percentile(each, percent) for each in (without_ms, with_ms))
        print(
            f"p{percent} of {PARTS} parts: {open_ms:.1f} ms with {BROWSERS} browsers, "
            f"{alone_ms:.1f} ms without, ratio {open_ms / alone_ms:.2f}"
        )
    alone_ms = (before.used_ms + after.used_ms) / 2
    print(f"processor time of a part: {seen.used_ms:.1f} ms with, {alone_ms:.1f} ms without")
    grown_mb = np.subtract(seen.late_mb, seen.early_mb)
    print(f"memory of a page: {max(seen.early_mb):.1f} MB, {max(grown_mb):+.1f} MB to the end")
    assert max(grown_mb) < 2.0
    assert seen.bench.memory_mb is not None
    early_mb, late_mb = seen.bench.memory_mb
    print(f"memory of the station: {early_mb:.0f} MB after a tenth, {late_mb:.0f} MB at the end")
    assert late_mb - early_mb < 30.0
