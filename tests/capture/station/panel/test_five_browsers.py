"""Five browsers on the operator's page of a station that judges part after part.

``PARTS`` is the number of parts with the browsers, and as many without, half of them before and
half after; ``FRAME_PX`` is the side of their images. Parts are triggered as fast as the station
takes them. The browsers stand for panel computers, but draw five pages with the two cores that
judge the parts: with the policy SCHED_IDLE they use what the station leaves.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from select import select

import numpy as np
import pytest

from tests.chromium import Page, chromium

PARTS = int(os.environ.get("PARTS", "20"))
FRAME_PX = int(os.environ.get("FRAME_PX", "256"))
BROWSERS, CLASSES = 5, 30
# Preparation, and the longest time of a part on a machine that does other work too.
SILENCE_S = 300.0 + 5.0 * PARTS
END_S = 60.0
# The number of judged parts that a page shows.
JUDGED = (
    "['PASS', 'FAIL', 'UNKNOWN', 'ERROR'].map((name) => document.getElementById('count-' + name))"
    ".reduce((sum, count) => sum + Number(count.textContent), 0)"
)


@dataclass(frozen=True)
class Watched:
    """A run with browsers.

    Attributes
    ----------
    latencies_ms
        From the end of the last exposure to the announced result, of each part.
    station_mb
        Memory of the station after a tenth of the parts, and at the end.
    used_ms
        Processor time of the station and its panel for each part.
    early_mb, late_mb
        The heap of each page after a tenth of the parts, and at the end.
    """

    latencies_ms: list[float]
    station_mb: tuple[float, float]
    used_ms: float
    early_mb: list[float]
    late_mb: list[float]


def heap_mb(page: Page) -> float:
    """Memory of the page's scripts, without what nobody needs any more."""
    page.call("HeapProfiler.collectGarbage")
    return float(page.call("Runtime.getHeapUsage")["usedSize"]) / 1e6


def station(stack: ExitStack, *arguments: object) -> tuple[Callable[[], str], Callable[[], None]]:
    """Start the bench with its panel; return what reads a line of it, and what lets it begin."""
    process = stack.enter_context(
        subprocess.Popen(
            (sys.executable, "-m", f"{__package__}.watched_bench", *map(str, arguments)),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
    )
    assert process.stdin is not None
    assert process.stdout is not None
    commands, lines = process.stdin, process.stdout

    def line() -> str:
        assert select([lines], [], [], SILENCE_S)[0], "the station says nothing"
        return lines.readline().decode()

    def begin() -> None:
        commands.write(b"\n")
        commands.flush()

    def end() -> None:
        commands.close()
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()

    stack.callback(end)
    return line, begin


def watched(folder: Path, parts: int, browsers: int) -> Watched:
    """Judge parts while browsers show the operator's page."""
    with ExitStack() as stack:
        line, begin = station(stack, folder, parts, FRAME_PX, CLASSES)
        url, pages = line().strip(), []
        if browsers:
            browser = stack.enter_context(chromium(folder.parent / "profile", is_elsewhere=True))
            pages = [browser.page(url, alone=True) for _ in range(browsers)]
        for page in pages:
            page.call("HeapProfiler.enable")
        begin()
        for page in pages[:1]:
            page.until(f"{JUDGED} >= {parts // 10}", SILENCE_S, pause_s=1.0)
        early_mb = [heap_mb(page) for page in pages]
        found = json.loads(line())
        for page in pages:
            page.until(f"document.getElementById('part').textContent == '{found['last_part']}'")
            assert page.value(JUDGED) == parts
            # The bench keeps the last sets only; pictures of the others cannot be made. Requests of
            # a browser that gets no processor are cut off.
            expected = ("/pictures", "net::ERR_")
            errors = [each for each in page.errors() if not any(part in each for part in expected)]
            assert errors == []
        bench = found["bench"]
        return Watched(
            bench["latencies_ms"],
            bench["memory_mb"],
            found["used_ms"],
            early_mb,
            [heap_mb(page) for page in pages],
        )


@pytest.mark.browser
def test_browsers_see_every_part_and_cost_no_memory(tmp_path: Path) -> None:
    before = watched(tmp_path / "before" / "bench", PARTS // 2, 0)
    seen = watched(tmp_path / "seen" / "bench", PARTS, BROWSERS)
    after = watched(tmp_path / "after" / "bench", PARTS // 2, 0)
    without_ms = np.array([*before.latencies_ms, *after.latencies_ms])
    with_ms = np.array(seen.latencies_ms)
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
    early_mb, late_mb = seen.station_mb
    print(f"memory of the station: {early_mb:.0f} MB after a tenth, {late_mb:.0f} MB at the end")
    assert late_mb - early_mb < 30.0
