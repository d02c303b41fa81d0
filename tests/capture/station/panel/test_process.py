"""The panel's process beside `ps4rig station run`: killed, stopped, and left alone."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from capture.station.domain.recipe_file import RecipeFolder
from capture.station.judge.approval import approve
from capture.station.panel.process import _FIRST_PAUSE_S
from capture.station.panel.station_link import _RECONNECT_S, NO_RUN
from tests.capture.station.panel.panels import WAIT_S, Client
from tests.capture.station.production import configure
from tests.waiting import until_so

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not Path("/proc").is_dir(), reason="finds processes in /proc"),
]
# A verdict takes some 20 ms on an idle machine. One that waits for the panel takes `STOPPED_S`.
STOPPED_S = 8.0
# From a kill to the answer with the present part: the pauses of both sides, and the processor time
# of the new process. On an idle machine that is the time.
MOST_RESTART_S = 1.0


def children(process: int) -> list[int]:
    """The processes whose parent is `process`."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(status.read_text().rpartition(")")[2].split()[1])
        except OSError:  # it has ended
            continue
        if parent == process:
            found.append(int(status.parent.name))
    return found


def processor_s(process: int) -> float:
    """The processor time that a process has taken."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@dataclass
class Run:
    """A run with its panel, and the events that it has printed."""

    process: subprocess.Popen[str]
    client: Client
    events: list[dict[str, Any]] = field(default_factory=list)

    def panel(self) -> int:
        """The process of the panel: the one that a fork server has forked."""
        return until_so(
            lambda: [grown for child in children(self.process.pid) for grown in children(child)]
        )[0]

    def state(self) -> dict[str, Any]:
        return dict(self.client.get("/api/v1/state").json)

    def parts(self) -> list[dict[str, Any]]:
        return [event for event in self.events if event["event"] == "part"]

    def until_parts(self, count: int) -> None:
        until_so(lambda: len(self.parts()) >= count)


@pytest.fixture
def run(station: Path, files: RecipeFolder, small_rig: Path) -> Iterator[Run]:
    assert small_rig
    approve(files, "Ada")
    configure(station, timer_s=0.3)
    command = [sys.executable, "-m", "capture", "station", "run", str(station), "--json"]
    with subprocess.Popen(
        [*command, "--trigger", "timer", "--port", "0"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        found = re.search(r"panel: (http://\S+)", process.stderr.readline())
        running, output = Run(process, Client(found[1])), process.stdout

        def read() -> None:
            running.events.extend(map(json.loads, output))

        reading = threading.Thread(target=read, daemon=True)
        reading.start()
        try:
            running.until_parts(1)
            yield running
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            reading.join(WAIT_S)


def test_a_killed_panel_answers_again_and_a_stopped_one_delays_no_verdict(
    run: Run, show_figures: Callable[[str], None]
) -> None:
    before = run.state()
    for _ in range(2):
        os.kill(run.panel(), signal.SIGKILL)
        killed_s = time.monotonic()
        # What waits in the socket of the run is answered; only a request being served is lost.
        while True:
            try:
                state = run.state()
                break
            except OSError:
                assert time.monotonic() - killed_s < WAIT_S
        while state["reason"] == NO_RUN:
            state = run.state()
        restart_s = _FIRST_PAUSE_S + _RECONNECT_S + processor_s(run.panel())
        show_figures(
            f"a panel restarts in {restart_s:.2f} s, {time.monotonic() - killed_s:.2f} s here"
        )
        assert restart_s < MOST_RESTART_S
        assert time.monotonic() - killed_s < WAIT_S
        assert state["run"] == before["run"]
        assert sum(state["announced"].values()) >= sum(before["announced"].values())
    stopped, parts = run.panel(), len(run.parts())
    os.kill(stopped, signal.SIGSTOP)
    try:
        time.sleep(STOPPED_S)
    finally:
        os.kill(stopped, signal.SIGCONT)
    assert len(run.parts()) > parts + 2
    assert max(part["latency_ms"] for part in run.parts()) < 1e3 * STOPPED_S / 2
    while (state := run.state())["last"]["part_id"] != run.parts()[-1]["part_id"]:
        assert state["state"] != "error"
    panel = run.panel()
    os.killpg(run.process.pid, signal.SIGINT)  # as Ctrl-C does
    assert run.process.wait(WAIT_S) == 130
    assert not Path(f"/proc/{panel}").exists()
    assert run.process.stderr is not None
    warnings = [line for line in run.process.stderr if "the panel ended" in line]
    assert len(warnings) == 2


def test_a_panel_ends_with_a_run_that_is_killed(run: Run) -> None:
    panel = run.panel()
    run.process.kill()
    until_so(lambda: not Path(f"/proc/{panel}").exists())


def test_a_panel_of_its_own_outlives_runs(
    station: Path, files: RecipeFolder, small_rig: Path
) -> None:
    assert small_rig
    approve(files, "Ada")
    configure(station, timer_s=0.3)
    command = [sys.executable, "-m", "capture", "station", "panel", str(station), "--port", "0"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        found = re.search(r"panel: (http://\S+)", process.stderr.readline())
        client = Client(found[1])
        assert client.get("/api/v1/state").json["reason"] == NO_RUN
        command[4:] = ["run", str(station), "--no-panel", "--trigger", "http", "--parts", "1"]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as run:
            while client.post("/api/v1/trigger").status != 202:
                time.sleep(0.05)
            assert run.wait(WAIT_S) in (0, 1)
        while client.get("/api/v1/state").json["reason"] != NO_RUN:
            time.sleep(0.02)
        assert len(client.get("/api/v1/parts?simulated=true").json["parts"]) == 1
        process.send_signal(signal.SIGTERM)
        assert process.wait(WAIT_S) == 130


def test_a_run_does_not_load_what_only_its_panel_needs() -> None:
    modules = ("capture.__main__", "capture.commands.station_run", "capture.station.run.run",
               "capture.commands.station_interfaces", "capture.station.panel.process")  # fmt: skip
    code = f"import {', '.join(modules)}, sys; print(*sys.modules)"
    loaded = subprocess.check_output((sys.executable, "-c", code), text=True, timeout=WAIT_S)
    assert not {"fastapi", "starlette", "uvicorn"} & set(loaded.split())
