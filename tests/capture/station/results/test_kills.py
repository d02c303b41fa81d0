"""Stations and database servers that are killed again and again lose and double nothing.

``KILLS`` is the number of kills of each test.
"""

import os
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from capture.station.domain.verdict import Decision
from capture.station.results.store import open_store
from capture.station.results.verification import contradictions
from tests.postgresql_server import PostgresqlServer

ROOT = Path(__file__).parents[4]
KILLS = int(os.environ.get("KILLS", "5"))
STATIONS = ("line-1", "line-2")
# A kill comes after up to so many more parts, and so much later: longer than a part takes.
_MOST_PARTS, _LATEST_S = 10, 0.01

Start = Callable[[str, int], subprocess.Popen[bytes]]


def announced_by(folder: Path, station: str) -> list[str]:
    """Whole lines that a station has announced."""
    path = folder / station
    return path.read_text().split("\n")[:-1] if path.exists() else []


@pytest.fixture
def start(database: str, tmp_path: Path) -> Iterator[Start]:
    """Starts a station that writes to `database`; see `worker`."""
    processes = []

    def start(station: str, parts: int) -> subprocess.Popen[bytes]:
        module = "tests.capture.station.results.worker"
        command = (sys.executable, "-m", module, database, station, str(parts), tmp_path / station)
        processes.append(subprocess.Popen(command, cwd=ROOT))
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        process.wait()


def assert_whole(database: str, folder: Path, station: str) -> int:
    """Assert that every announced part has its one row, and return the number of parts."""
    with open_store(database, station) as store:
        rows = [entry.result for entry in store.parts()]
        assert list(contradictions(store)) == []
        assert store.unfinished() == []
    assert [row.number for row in rows] == list(range(1, len(rows) + 1))
    assert len({row.part_id for row in rows}) == len(rows)
    announced = announced_by(folder, station)
    assert len(set(announced)) == len(announced)
    assert set(announced) <= {f"{row.part_id} {row.verdict.decision}" for row in rows}
    assert sum(row.verdict.decision is Decision.ERROR for row in rows) <= KILLS
    return len(rows)


def wait_for(folder: Path, station: str, parts: int, process: subprocess.Popen[bytes]) -> None:
    while len(announced_by(folder, station)) < parts and process.poll() is None:
        time.sleep(0.001)


@pytest.mark.parametrize(
    "database",
    [
        pytest.param("sqlite", marks=pytest.mark.slow),
        pytest.param("postgresql", marks=pytest.mark.postgresql),
    ],
    indirect=True,
)
def test_a_killed_station_loses_and_doubles_no_result(
    database: str, start: Start, tmp_path: Path
) -> None:
    choice = random.Random(20261122)
    for _ in range(KILLS):
        killed, other = (start(station, 1_000_000) for station in STATIONS)
        parts = len(announced_by(tmp_path, "line-1")) + choice.randint(1, _MOST_PARTS)
        wait_for(tmp_path, "line-1", parts, killed)
        time.sleep(choice.uniform(0.0, _LATEST_S))
        killed.kill()
        other.kill()
        assert (killed.wait(), other.wait()) == (-9, -9)
    for station in STATIONS:
        assert start(station, 1).wait() == 0
        assert assert_whole(database, tmp_path, station) >= 1


@pytest.mark.postgresql
@pytest.mark.parametrize("database", ["postgresql"], indirect=True)
def test_stations_outlive_a_killed_server(
    database: str, start: Start, server: PostgresqlServer, tmp_path: Path
) -> None:
    choice = random.Random(20261122)
    working = {station: start(station, 40 * KILLS) for station in STATIONS}
    for station, process in working.items():  # one that starts ends with its database
        wait_for(tmp_path, station, 1, process)
    for _ in range(KILLS):
        parts = len(announced_by(tmp_path, "line-1")) + choice.randint(1, _MOST_PARTS)
        wait_for(tmp_path, "line-1", parts, working["line-1"])
        time.sleep(choice.uniform(0.0, _LATEST_S))
        server.kill()
        server.start()
    for station, process in working.items():
        assert process.wait() == 0
        assert assert_whole(database, tmp_path, station) == 40 * KILLS
        assert len(announced_by(tmp_path, station)) == 40 * KILLS
