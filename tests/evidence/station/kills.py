"""Kill a production again and again, and print what was lost: the figures of the README.

    python -m tests.evidence.station.kills --kills 300
    python -m tests.evidence.station.kills --kills 50 --postgresql
    python -m tests.evidence.station.kills --kills 300 --panel

With ``--postgresql`` two stations write to one server, which is killed, too. With ``--panel`` run,
panel, PLC and server of one station are killed in random order: see `line_kills`.
"""

import argparse
import os
import random
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

# The kernels of forked processes run in one thread.
os.environ |= {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

import cv2

from capture.station.results.verification import verify_station
from tests.capture.station.production import contradictions, taught_station
from tests.evidence.station import line_kills, watched_panel
from tests.evidence.station.forked_run import ForkedRun
from tests.evidence.station.line_kills import killed_line
from tests.evidence.station.two_recipes import rows_of, station_with_two_recipes
from tests.postgresql_server import postgresql_server

# The server is killed with every so many kills of a station.
_SERVER_KILLED_EVERY = 10
# A kill comes after up to so many announced parts, and so much later: longer than a part takes.
_MOST_PARTS, _LATEST_S = 3, 0.4


def main(kills: int, *, on_postgresql: bool, seed: int) -> int:
    """Print the figures; return the exit status."""
    cv2.setNumThreads(1)
    choice = random.Random(seed)
    with tempfile.TemporaryDirectory(prefix="ps4rig-kills-") as place:
        folder = Path(place)
        if not on_postgresql:
            return _told(kills, [taught_station(folder / "line-1")], choice)
        with postgresql_server() as server:
            folders = [taught_station(folder / name, results=server.url) for name in ("a", "b")]

            def between(number: int) -> None:
                if number % _SERVER_KILLED_EVERY == _SERVER_KILLED_EVERY - 1:
                    server.kill()
                    server.start()

            return _told(kills, folders, choice, between)


def all_killed(kills: int, seed: int) -> int:
    """Kill run, panel, PLC and database; print the figures and return the exit status."""
    with (
        tempfile.TemporaryDirectory(prefix="ps4rig-kills-") as place,
        postgresql_server() as server,
    ):
        folder = station_with_two_recipes(Path(place), results=server.url)
        journal = killed_line(folder, kills, random.Random(seed), server).read()
        rows = rows_of(folder)
        wrong = [
            *line_kills.contradictions(rows, journal),
            *watched_panel.contradictions(rows, journal),
            *(str(each) for each in verify_station(folder) if each.state != "good"),
        ]
    judged, shown = (sum(name in each for each in journal) for name in ("number", "shown"))
    again = sum("snapshot" in each for each in journal)
    print(
        f"{kills} kills: {len(rows)} parts begun; the PLC sorted {judged}, the browser was shown "
        f"{shown} and began anew {again} times; {len(wrong)} lost, doubled or contradicted"
    )
    print(*wrong, sep="\n", end="")
    return int(bool(wrong))


def _told(kills: int, folders: list[Path], choice: random.Random, between=lambda _: None) -> int:
    events = killed_production(folders, kills, choice, between)
    wrong = [said for folder in folders for said in contradictions(folder, events[folder])]
    counts = Counter(event["event"] for each in events.values() for event in each)
    print(
        f"{kills} kills: {counts['begun']} parts begun, {counts['part']} announced, "
        f"{counts['recovered']} recovered as ERROR; {len(wrong)} lost, doubled or contradicted"
    )
    print(*wrong, sep="\n", end="")
    return int(bool(wrong))


def killed_production(
    folders: list[Path], kills: int, choice: random.Random, between: Any = lambda _: None
) -> dict[Path, list[dict[str, Any]]]:
    """Run stations at the same time, kill one after the other, and run each to its end.

    Parameters
    ----------
    folders
        The stations.
    kills
        Number of kills.
    choice
        When and which.
    between
        Called with the number of each kill, for what else happens then.

    Returns
    -------
    dict
        All events of each station.
    """
    events: dict[Path, list[dict[str, Any]]] = {folder: [] for folder in folders}
    runs = {folder: ForkedRun.start(folder) for folder in folders}
    try:
        for number in range(kills):
            folder = choice.choice(folders)
            run = runs[folder]
            run.read_until(run.announced() + choice.randint(0, _MOST_PARTS))
            between(number)
            time.sleep(choice.uniform(0.0, _LATEST_S))
            run.kill()
            events[folder] += run.events
            runs[folder] = ForkedRun.start(folder)
    finally:  # a run would go on for ever
        for run in runs.values():
            run.kill()
    for folder, run in runs.items():
        events[folder] += run.events
        last = ForkedRun.start(folder, parts=3)
        last.wait()
        events[folder] += last.events
    return events


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    options.add_argument("--kills", type=int, default=300)
    options.add_argument("--postgresql", action="store_true")
    options.add_argument("--panel", action="store_true")
    options.add_argument("--seed", type=int, default=20260101)
    given = options.parse_args()
    if given.panel:
        sys.exit(all_killed(given.kills, given.seed))
    sys.exit(main(given.kills, on_postgresql=given.postgresql, seed=given.seed))
