"""A long production: memory, open files, and whether files, rows and announcements agree.

    python -m tests.evidence.station.endurance --parts 20000

Ctrl-C ends the production, and what there is by then is checked. Frames are of 256 px, the smallest
that a defect model learns from, and every part is judged. A few placements come again and again,
because to render each anew would take a third of the time; the noise of their pictures is new.
"""

import argparse
import gc
import json
import os
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple
from unittest.mock import patch

# The kernels run in one thread, so that other tests have the other cores.
os.environ |= {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

from capture.base.names import SET_SUFFIX
from capture.base.process_settings import configure_process, configure_station_process
from capture.base.utc_time import utc_text
from capture.station.domain.config import SimulatedParts
from capture.station.domain.folder import StationFolder
from capture.station.domain.simulated_parts import SimulatedPart, simulated_part
from capture.station.results.store import open_store
from capture.station.run.control_chart import ControlChart
from capture.station.run.events import PartAnnounced
from capture.station.run.live_station import LiveStation
from capture.station.run.live_view import LiveEvent
from tests.capture.station.production import (
    contradictions,
    run_parts,
    taught_station,
)
from tests.evidence.station.memory_folder import in_memory
from tests.memory_growth import resident_mb

# Their scenes, of 2.4 MB each, fit into the cache of the simulated rig (rig/simulation/scenes.py).
PLACEMENTS = 20
# The retention runs beside the parts, as it does in months: so long a set stays, and so often old
# ones are removed. 20,000 sets would take 13 GB.
KEPT_S, REMOVED_EACH_S = 20.0, 10.0
# Lines of the printed table.
LINES = 20
# Growth of the resident memory over the last half of a run that still counts as flat: of all its
# readings, and at the pace of the median between two readings. By the half of 20,000 parts all that
# a run keeps is full: 10,000 hashes of pixels (2 MB), 1,000 events, 28 points of each chart, 128
# statements of each connection. The allocator still takes a little. A leak of 110 bytes a part
# exceeds the second limit.
MOST_MB, FLAT_MB = 3.0, 1.0
# In a shorter run the allocator still takes up to 5 kB a part. Images that stay exceed this limit:
# they have 128 kB each.
LONG_PARTS, SHORT_MB = 20_000, 20.0
# Of the set files, one in so many is read whole and hashed: all of them would take as long as a
# tenth of the run.
READ_EVERY = 20


class Reading(NamedTuple):
    """What a run needs after some parts."""

    parts: int
    memory_mb: float
    open_files: int  # the least since the reading before: a set in writing has three for a moment
    cpu_ms: float  # of a part, since the reading before


def known_part(feed: SimulatedParts, number: int, frame_px: int) -> SimulatedPart:
    """A part whose scene was rendered already, but for the first ones."""
    return simulated_part(feed, number % PLACEMENTS, frame_px)


def some_time_ago(*_: object) -> str:
    """Until when the retention removes sets, instead of a week ago."""
    return utc_text(datetime.now(UTC) - timedelta(seconds=KEPT_S), timespec="milliseconds")


def produce(folder: Path, parts: int, announced: Path) -> list[Reading]:
    """Run the station, write its events to a file, and read memory and open files.

    What every run keeps of its parts, for interfaces and control charts, is there, too.
    """
    readings: list[Reading] = []
    open_files: list[int] = []
    every = max(1, parts // LINES)
    before_s = time.process_time()
    live = LiveStation(folder.name, simulated=True)
    chart = ControlChart([f"LED {number}" for number in range(4)], live.publish)
    with announced.open("w", encoding="utf-8") as file:

        def listen(published: LiveEvent) -> None:
            nonlocal before_s
            event = published.event
            chart(published)
            file.write(published.as_json + "\n")
            if not isinstance(event, PartAnnounced):
                return
            number = event.result.number
            open_files.append(len(list(Path("/proc/self/fd").iterdir())))
            if number % every == 0:
                gc.collect()
                now_s = time.process_time()
                cpu_ms = 1e3 * (now_s - before_s) / every
                readings.append(Reading(number, resident_mb(), min(open_files), cpu_ms))
                print("{:6} {:14.1f} {:12} {:18.1f}".format(*readings[-1]), flush=True)
                before_s = now_s
                open_files.clear()

        with (
            suppress(KeyboardInterrupt),
            patch("capture.station.run.station_rig.simulated_part", known_part),
            patch("capture.station.run.retention.removed_until", some_time_ago),
            patch("capture.station.run.retention.PERIOD_S", REMOVED_EACH_S),
        ):
            run_parts(folder, parts, listen, live=live)
    return readings


def faults_of(readings: list[Reading]) -> list[str]:
    """Say what grows."""
    half = len(readings) // 2
    if half == 0:
        return ["the run was too short to say what grows"]
    first, last = readings[:half], readings[half:]
    steps_mb = [after.memory_mb - before.memory_mb for before, after in pairwise(last)] or [0.0]
    found = []
    is_long = readings[-1].parts >= LONG_PARTS
    for name, grown_mb, limit_mb in (
        ("", max(each.memory_mb for each in last) - last[0].memory_mb, MOST_MB),
        ("steadily ", len(last) * median(steps_mb), FLAT_MB),
    ):
        limit_mb = limit_mb if is_long else SHORT_MB
        if grown_mb >= limit_mb:
            found.append(f"memory {name}grows by {grown_mb:.1f} MB in the last half")
    # A second reader of the database may come late, with two files.
    if max(each.open_files for each in last) > max(each.open_files for each in first) + 2:
        found.append("more and more files are open")
    return found


def main(parts: int) -> int:
    """Print the figures; return the exit status."""
    configure_process()  # as `ps4rig station run` does, so that the allocator works as there
    # A tenth of the parts does not pass, and the sample is one in twenty of the others.
    with tempfile.TemporaryDirectory(
        prefix="ps4rig-endurance-", dir=in_memory(parts // 4)
    ) as place:
        folder, announced = Path(place) / "line-1", Path(place) / "announced"
        taught_station(folder)
        configure_station_process()
        print(" parts   memory in MB   open files   ms of CPU a part")
        wrong = faults_of(produce(folder, parts, announced))
        with announced.open(encoding="utf-8") as lines:
            events: list[dict[str, Any]] = [json.loads(line) for line in lines]
        wrong += contradictions(folder, events, read_every=READ_EVERY)
        told = Counter(event["decision"] for event in events if event["event"] == "part")
        station = StationFolder(folder)
        with open_store(station.results, station.config.name) as store:
            rows = store.counters().simulated.parts
            removed = sum(entry.set_removed_utc is not None for entry in store.parts())
        kept = sum(1 for _ in (folder / "parts").glob(f"*/*{SET_SUFFIX}"))
        if not told.total() == rows == parts == removed + kept:
            wrong.append(
                f"{told.total()} announced, {rows} rows, {kept} files and {removed} removed ones "
                f"of {parts} parts"
            )
        if told["ERROR"]:
            wrong.append(f"{told['ERROR']} parts were not judged")
    verdicts = ", ".join(f"{count} {decision}" for decision, count in sorted(told.items()))
    print(f"{told.total()} announced, {rows} rows: {verdicts}")
    print(f"{kept} set files; the retention removed {removed}")
    print(f"{len(wrong)} faults", *wrong, sep="\n")
    return int(bool(wrong))


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    options.add_argument("--parts", type=int, default=20000)
    sys.exit(main(options.parse_args().parts))
