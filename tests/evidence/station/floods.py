"""The time to a verdict while clients flood the panel, beside that without clients.

    python -m tests.evidence.station.floods [--quick] [--parts N] [--rows N]

The bench of a station (1024 x 1024 px, 30 classes, parts as fast as they are judged) runs with its
panel on the same two cores. The clients have the policy SCHED_IDLE, as other machines would cost
nothing here. For each flood the 99th percentile is divided by that of the run before it without
clients; the limit is 1.05. Each figure is printed as soon as it is known. The quick form has 40
parts, whose 99th percentile is the slowest one: it shows that all floods run, not the limit.
"""

import argparse
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from contextlib import suppress
from http.client import HTTPException
from pathlib import Path

import numpy as np

from capture.station.domain.folder import StationFolder, make_station
from capture.station.domain.users import Role, Users
from capture.station.results.store import open_store
from tests.capture.station.results import many

_LIMIT = 1.05
_FRAME_PX, _CLASSES = 1024, 30
_KILLED_EACH_S = 10.0
_GUESSES = "20 guess a password"
# Paths that each of so many clients asks for again and again.
FLOODS: dict[str, tuple[int, tuple[str, ...]]] = {
    "20 CSV exports": (20, ("api/v1/parts.csv",)),
    "40 readers of the history": (40, ("history", "api/v1/parts?limit=500")),
    "500 event streams": (500, ("api/v1/events",)),
    "4 readers of statistics": (4, ("statistics", "api/v1/statistics")),
    _GUESSES: (20, ("login",)),
    "the panel is killed": (0, ()),
}


def ask(url: str, data: bytes | None) -> None:
    """Read an answer to its end."""
    # An answer that the panel cuts off raises an HTTPException.
    with (
        suppress(OSError, HTTPException),
        urllib.request.urlopen(url, data, timeout=60.0) as answer,
    ):
        while answer.read(1 << 16):
            pass


def be_the_clients(station: str, flood: str) -> None:
    """Ask until the process is killed."""
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    count, paths = FLOODS[flood]
    data = b"name=kim&password=wrong" if paths == ("login",) else None

    def loop() -> None:
        for path in itertools.cycle(paths):
            ask(station + path, data)
            time.sleep(0.001)

    for _ in range(count):
        threading.Thread(target=loop, daemon=True).start()
    signal.pause()


def kill_panels(run: int, is_over: threading.Event) -> None:
    """Kill the panel of a run again and again: the process that descends from it and serves."""
    while not is_over.wait(_KILLED_EACH_S):
        listed = subprocess.run(["ps", "-eo", "pid,ppid,cls"], capture_output=True, text=True)
        rows = [line.split() for line in listed.stdout.splitlines()[1:]]
        children = {int(pid): (int(parent), policy) for pid, parent, policy in rows}
        for pid, (parent, policy) in children.items():
            if policy == "IDL" and run in (parent, children.get(parent, (0, ""))[0]):
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)


def fill(folder: Path, rows: int) -> None:
    """Make a station with the results of `rows` parts."""
    make_station(folder)
    station = StationFolder(folder)
    with open_store(station.results, station.config.name, create=True) as store:
        many.fill(store, many.many(store.station, rows))


def latencies_ms(folder: Path, parts: int, flood: str | None) -> list[float]:
    """Judge `parts` parts under a flood; return the time of each from exposure to result."""
    if flood == _GUESSES:
        Users(folder).put("kim", Role.ADMINISTRATOR, "not wrong at all")
    bench = [sys.executable, "-m", "tests.evidence.station.watched_bench", str(folder)]
    numbers = [str(number) for number in (parts, _FRAME_PX, _CLASSES)]
    clients: subprocess.Popen[bytes] | None = None
    is_over = threading.Event()
    with subprocess.Popen(
        [*bench, *numbers], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as run:
        assert run.stdin is not None
        assert run.stdout is not None
        address = run.stdout.readline().strip()
        if flood is not None and FLOODS[flood][0]:
            this = [sys.executable, "-m", "tests.evidence.station.floods"]
            clients = subprocess.Popen([*this, "--clients", flood, "--station", address])
        elif flood is not None:
            threading.Thread(target=kill_panels, args=(run.pid, is_over), daemon=True).start()
        print("go", file=run.stdin, flush=True)
        try:
            result = json.loads(next(line for line in run.stdout if line.startswith("{")))
        finally:
            is_over.set()
            if clients is not None:
                clients.kill()
                clients.wait()
            run.stdin.close()
    measured: list[float] = result["bench"]["latencies_ms"]
    return measured


def main(parts: int, rows: int) -> int:
    """Print a row for each flood; return 1 if one is beyond the limit."""
    print(f"{'':28}{'quiet p99 ms':>13}{'p50 ms':>8}{'p99 ms':>8}{'ratio':>7}", flush=True)
    beyond = 0
    with tempfile.TemporaryDirectory(prefix="ps4rig-floods-") as place:
        filled = Path(place) / "bench"
        fill(filled, rows)
        for flood in FLOODS:
            quiet = np.percentile(_latencies_of_copy(filled, parts, None), 99.0)
            print(f"{flood:28}{quiet:13.0f}", end="", flush=True)
            half, slow = np.percentile(_latencies_of_copy(filled, parts, flood), (50.0, 99.0))
            beyond += slow > _LIMIT * quiet
            print(f"{half:8.0f}{slow:8.0f}{slow / quiet:7.2f}", flush=True)
    return int(beyond > 0)


def _latencies_of_copy(filled: Path, parts: int, flood: str | None) -> list[float]:
    with tempfile.TemporaryDirectory(prefix="ps4rig-floods-") as place:
        return latencies_ms(shutil.copytree(filled, Path(place) / "bench"), parts, flood)


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    options.add_argument("--quick", action="store_true", help="40 parts, 500 rows")
    options.add_argument("--parts", type=int, default=300)
    options.add_argument("--rows", type=int, default=8000)
    options.add_argument("--clients", choices=FLOODS, help=argparse.SUPPRESS)
    options.add_argument("--station", help=argparse.SUPPRESS)
    given = options.parse_args()
    if given.clients:
        be_the_clients(given.station, given.clients)
    sys.exit(main(40, 500) if given.quick else main(given.parts, given.rows))
