"""Kill station and PLC in mid-handshake, and look whose results were taken: figures of the README.

    python -m tests.evidence.station.line_kills --kills 300

The station is a taught one on the simulated rig, the PLC is the example client, and a third process
reads the registers all the time. Each is a process of its own, and all talk by Modbus TCP. Every
other PLC needs another recipe, so that changes of the recipe are killed, too.
"""

import argparse
import itertools
import json
import os
import random
import signal
import socket
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from capture.station.run.triggers import NoTriggers

# The kernels of forked processes run in one thread.
os.environ |= {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

import cv2

from capture.base.utc_time import utc_text
from capture.station.domain.folder import station_folder
from capture.station.domain.interface_config import ModbusConfig
from capture.station.domain.verdict import Cause, Decision
from capture.station.line.example_client import Judged, run_ladder
from capture.station.line.handshake import Handshake
from capture.station.line.line import PlcLine
from capture.station.line.modbus import PlcConnection, serving_modbus
from capture.station.line.registers import VERDICTS, Status
from capture.station.results.part_result import PartResult
from capture.station.run.live_socket import serving_live
from capture.station.run.live_station import LiveStation
from capture.station.run.run import run_station
from classify.base.errors import Ps4rigError
from tests.capture.station.line.lines import WAIT_S
from tests.capture.station.production import SMALL_RIG
from tests.evidence.station.two_recipes import (
    RECIPES,
    recipe_changes,
    rows_of,
    station_with_two_recipes,
)
from tests.evidence.station.watched_panel import be_the_browser, be_the_panel
from tests.free_port import free_port
from tests.postgresql_server import PostgresqlServer

# A kill comes after up to so many parts, and so much later: longer than a part takes.
_MOST_PARTS, _LATEST_S = 2, 0.4
_LAST_PARTS = 3
_ENDLESS = 1 << 30
_MOST_SESSIONS = 1000  # of the stations that are started after a kill
_PAUSE_S = 0.01
_HOST = "127.0.0.1"


class Journal:
    """Lines of JSON that several processes append to one file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        path.touch()

    def write(self, **fields: Any) -> None:
        with self._path.open("ab", buffering=0) as file:
            file.write(json.dumps(fields).encode() + b"\n")

    def read(self) -> list[dict[str, Any]]:
        lines, _, _ = self._path.read_bytes().rpartition(b"\n")  # the last may be incomplete
        return [json.loads(line) for line in lines.splitlines()]


def forked(work: Callable[[], None]) -> int:
    """Run something in a process of its own; return its id."""
    process = os.fork()
    if process:
        return process
    status = 1
    try:
        work()
        status = 0
    except BaseException as error:
        os.write(2, f"{error!r}\n".encode())
    finally:
        os._exit(status)


def be_the_station(folder: Path, port: int, session: int, journal: Journal) -> None:
    """Run a station whose triggers come by Modbus; start it again if it cannot run, as systemd."""
    for attempt in itertools.count():
        with suppress(Ps4rigError):
            _run_a_station(folder, port, session + attempt * _MOST_SESSIONS, journal)
        time.sleep(_PAUSE_S)


def _run_a_station(folder: Path, port: int, session: int, journal: Journal) -> None:
    journal.write(session=session, began_utc=utc_text(timespec="milliseconds"))
    with station_folder(folder) as opened:
        live = LiveStation(opened.config.name, simulated=True)
        handshake = Handshake(session, plc_triggers=True, station=live.state, recipes=RECIPES)
        line = PlcLine(live, handshake)
        with (
            live.telling(line.tell),
            serving_modbus(line, ModbusConfig(host=_HOST, port=port)),
            serving_live(opened, live),
        ):
            run_station(opened, SMALL_RIG, NoTriggers(), live)


def be_the_plc(port: int, name: str, parts: int, journal: Journal, recipe: int) -> None:
    """Trigger parts of a recipe, and write down which came and what became of them."""
    numbers = iter(range(parts))

    def next_part() -> str | None:
        number = next(numbers, None)
        if number is None:
            return None
        journal.write(came=f"{name}-{number}")
        return f"{name}-{number}"

    def note(judged: Judged) -> None:
        journal.write(**vars(judged), recipe=RECIPES[recipe - 1])

    run_ladder(_HOST, port, next_part, note, recipe)


def be_the_observer(port: int, journal: Journal) -> None:
    """Write down each result that is shown as valid."""
    seen = set()
    while True:
        with suppress(ConnectionError), PlcConnection(_HOST, port) as plc:
            while True:
                read = plc.read()
                if Status.RESULTS_VALID in Status(read["status"]):
                    names = "session", "result_number", "verdict", "cause"
                    shown = {name: read[name] for name in names}
                    if tuple(shown.values()) not in seen:
                        seen.add(tuple(shown.values()))
                        journal.write(**shown)
                time.sleep(0.001)
        time.sleep(_PAUSE_S)


def killed_line(
    folder: Path, kills: int, choice: random.Random, database: PostgresqlServer | None = None
) -> Journal:
    """Kill one side after the other, and let the last PLC end its parts.

    With a database it is killed too, and so is a panel, which a browser follows.
    """
    journal = Journal(folder.parent / "journal")
    sides = ["station", "plc"]
    watchers = [lambda: be_the_observer(port, journal)]
    if database is not None:
        listener = socket.create_server((_HOST, 0))
        sides += ["panel", "database"]
        watchers.append(lambda: be_the_browser(listener.getsockname()[1], journal.write))
    port = free_port()

    def start(which: str, number: int) -> int:
        if which == "station":
            return forked(lambda: be_the_station(folder, port, number + 1, journal))
        if which == "panel":
            return forked(lambda: be_the_panel(folder, listener))
        recipe = number % len(RECIPES) + 1
        return forked(lambda: be_the_plc(port, f"run{number}", _ENDLESS, journal, recipe))

    watching = [forked(watch) for watch in watchers]
    processes = {which: start(which, 0) for which in sides if which != "database"}

    def kill(which: str) -> None:
        os.kill(processes[which], signal.SIGKILL)
        os.waitpid(processes[which], 0)

    try:
        for number in range(1, kills + 1):
            _await_parts(journal, choice.randint(0, _MOST_PARTS))
            time.sleep(choice.uniform(0.0, _LATEST_S))
            which = choice.choice(sides)
            if which == "database" and database is not None:
                database.kill()
                database.start()
                continue
            kill(which)
            processes[which] = start(which, number)
        kill("plc")
        last = forked(lambda: be_the_plc(port, "last", _LAST_PARTS, journal, 1))
        processes["plc"] = last
        assert os.waitpid(last, 0)[1] == 0
        del processes["plc"]
    finally:
        for process in (*watching, *processes.values()):
            os.kill(process, signal.SIGKILL)
            os.waitpid(process, 0)
    return journal


def _await_parts(journal: Journal, count: int) -> None:
    def judged() -> int:
        return sum("number" in each for each in journal.read())

    ends, wanted = time.monotonic() + 2 * WAIT_S, judged() + count
    while judged() < wanted:
        assert time.monotonic() < ends, "the line stands still"
        time.sleep(_PAUSE_S)


def contradictions(rows: dict[int, PartResult], journal: list[dict[str, Any]]) -> Iterator[str]:
    """Say where the PLC took a result for another part's, or was shown an old one."""
    judged = [each for each in journal if "number" in each]
    for part in judged:
        row = rows.get(part["number"])
        is_error = part["verdict"] == VERDICTS[Decision.ERROR]
        if row is None:
            if not is_error or part["number"] is not None:
                yield f"{part} has no row"
        elif row.part_id != part["part_id"]:
            yield f"{part} has the number of {row.part_id}"
        elif not is_error and part["verdict"] != VERDICTS[row.verdict.decision]:
            yield f"{part}: its row says {row.verdict.decision}"
        elif not is_error and part.get("recipe", row.recipe) != row.recipe:
            yield f"{part} was judged by {row.recipe}"
    counts = Counter(part["part_id"] for part in judged)
    yield from (
        f"{part_id} was judged {count} times" for part_id, count in counts.items() if count > 1
    )
    last = [each["came"] for each in journal if each.get("came", "").startswith("last")]
    yield from (f"{part_id} was not judged" for part_id in last if part_id not in counts)
    began = {each["session"]: each["began_utc"] for each in journal if "began_utc" in each}
    for shown in (each for each in journal if "result_number" in each):
        row = rows[shown["result_number"]]
        is_interrupted = shown["cause"] == Cause.INTERRUPTED.plc_code
        if shown["verdict"] != VERDICTS[row.verdict.decision]:
            yield f"{shown}: its row says {row.verdict.decision}"
        elif row.triggered_utc < began[shown["session"]] and not is_interrupted:
            yield f"{shown}: it is a result of an earlier run"


def main(kills: int, seed: int) -> int:
    """Print the figures; return the exit status."""
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory(prefix="ps4rig-plc-") as place:
        folder = station_with_two_recipes(Path(place))
        journal = killed_line(folder, kills, random.Random(seed)).read()
        rows, changes = rows_of(folder), recipe_changes(folder)
    wrong = list(contradictions(rows, journal))
    judged = [part for part in journal if "number" in part]
    errors = sum(part["verdict"] == VERDICTS[Decision.ERROR] for part in judged)
    shown = sum("result_number" in each for each in journal)
    print(
        f"{kills} kills: {len(rows)} parts begun, {shown} results shown; the PLC sorted "
        f"{len(judged)} parts, {errors} of them as ERROR; {changes} changes of the recipe; "
        f"{len(wrong)} contradictions"
    )
    print(*wrong, sep="\n", end="")
    return int(bool(wrong))


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    options.add_argument("--kills", type=int, default=300)
    options.add_argument("--seed", type=int, default=20260101)
    given = options.parse_args()
    sys.exit(main(given.kills, given.seed))
