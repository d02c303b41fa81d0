"""The commands in a process without fcntl, terminals, and the signals that Windows lacks.

`sitecustomize.py` also opens no folder, syncs and waits for what Windows can, and renames no file
that is open.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
RUN = """
import contextlib, io, json, os, sys
from capture.cli import run
from capture.base.interrupts import install_handlers
install_handlers()
for line in sys.stdin:
    folder, *arguments = json.loads(line)
    os.chdir(folder)
    sys.argv = ["ps4rig", *arguments]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run()
    print(json.dumps((status, out.getvalue(), err.getvalue())), flush=True)
"""
PLAN = """
name = "stones"
orientations_deg = [0, 40]
turntable = '"{python}" -c pass {{angle}}'
[[specimen]]
id = "rock-1"
surface = "rock"
"""
RIG = '[lights]\nport = "simulated"\n[camera]\nwidth_px = 96\nheight_px = 96\n'
End = tuple[int, str, str]
Run = Callable[[str], End]
Ran = Callable[[str], str]


def start(*command: str, folder: Path, **options: Any) -> subprocess.Popen[str]:
    path = os.pathsep.join([str(HERE), str(ROOT), *sys.path])
    environment = os.environ | {"PYTHONPATH": path, "NUMBA_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, *command], cwd=folder, env=environment, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options,
    )  # fmt: skip


@pytest.fixture(scope="module")
def program() -> Iterator[subprocess.Popen[str]]:
    """One such process that runs a command for each line of its input."""
    with start("-c", RUN, folder=HERE) as process:
        yield process
        _, stderr = process.communicate(timeout=60.0)
        assert (process.returncode, stderr) == (0, "")


@pytest.fixture
def run(program: subprocess.Popen[str], tmp_path: Path) -> Run:
    """Run a command in `tmp_path`; return its status, output and errors."""
    (tmp_path / "rig.toml").write_text(RIG)

    def run_one(command: str) -> End:
        assert program.stdin is not None
        assert program.stdout is not None
        program.stdin.write(json.dumps([str(tmp_path), *command.split()]) + "\n")
        program.stdin.flush()
        status, out, err = json.loads(program.stdout.readline())
        return status, out, err

    return run_one


@pytest.fixture
def ran(run: Run) -> Ran:
    """Run a command without an error; return its output."""

    def run_well(command: str) -> str:
        status, out, err = run(command)
        assert (status, err) == (0, ""), command
        return out

    return run_well


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.mark.slow
def test_sets_are_captured_analysed_and_exported(ran: Ran, tmp_path: Path) -> None:
    (tmp_path / "sets").mkdir()
    capture = "capture --rig rig.toml --size 96 --rotate 0 --rotate 50"
    commands = {
        f"{capture} --surface rock --label rock sets/rock.ome.tif": "rock-002.ome.tif: 4 lights",
        f"{capture} --surface sand --label sand sets/sand.ome.tif": "sand-002.ome.tif: 4 lights",
        "train sets/rock-001.ome.tif sets/sand-001.ome.tif --library t.ps4lib": "classes 2",
        "classify sets/rock-002.ome.tif --library t.ps4lib --json": '"label": "rock"',
        "evaluate sets/rock-002.ome.tif --library t.ps4lib --json": '"sets": 1',
        "solve sets/rock-001.ome.tif --out maps": "maps: ",
        "solve sets/rock-002.ome.tif --out maps": "maps: ",  # replaces the folder
        "info sets/rock-001.ome.tif --set note=worn": "worn",
        "compare sets/rock-001.ome.tif sets/sand-001.ome.tif --json": '"distance"',
        "verify sets --json": '"files": 4,\n "findings": []',
        "export sets/rock-001.ome.tif lights": "lights: written",
        "export sets/rock-001.ome.tif rock.npz": "rock.npz: written",
        "rig lights off --rig sim": "all LEDs of SIM-0001 are out",
    }
    for command, answer in commands.items():
        assert answer in ran(command), command
    assert not [name for name in names(tmp_path) | names(tmp_path / "sets") if name[0] == "."]


@pytest.mark.slow
def test_a_session_is_run_resumed_and_reported(ran: Ran, tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(PLAN.format(python=sys.executable))
    ran("session run plan.toml --rig rig.toml --yes")
    journal = tmp_path / "stones" / "journal.json"
    # As another program of Windows may have written it.
    journal.write_text(journal.read_text().replace('"sets/', '"sets\\\\'))
    (tmp_path / "stones" / "sets" / "rock-1-40-1.ome.tif").unlink()
    assert json.loads(ran("session status stones --json"))["missing"]
    said = ran("session resume stones --rig rig.toml --yes")
    assert "1 sets captured" in said
    ran("session report stones")
    assert '"files": 3,\n "findings": []' in ran("verify stones --json")
    assert "sets/rock-1-40-1.ome.tif" in journal.read_text()
    assert (tmp_path / "stones" / "report.html").is_file()
    assert "session.lock" not in names(tmp_path / "stones")


@pytest.mark.parametrize(
    ("command", "cause"),
    [
        ("rig simulate --serial /dev/ttyGS0", "Linux only"),
        ("rig simulate --camera v4l2:/dev/video9", "Linux; set camera.kind = 'opencv'"),
        ("rig init new.toml", "serial ports"),
    ],
)
def test_what_needs_linux_says_so_in_one_line(run: Run, command: str, cause: str) -> None:
    status, out, err = run(command)
    assert (status, out) == (2, "")
    assert cause in err
    assert len(err.splitlines()) == 1


@pytest.mark.slow
def test_the_program_ends_as_elsewhere(tmp_path: Path) -> None:
    with start("-m", "capture", "info", "none.ome.tif", folder=tmp_path) as process:
        ended = process.communicate(timeout=120.0)
    assert (process.returncode, *ended) == (2, "", "ps4rig: none.ome.tif: no such file or folder\n")


INTERRUPTED = """
import signal, time
from capture.base.interrupts import install_handlers, interruptible
from rig.signals import signals_held_back

def act():
    signal.raise_signal(signal.SIGINT)
    print("acted to the end")

def act_held_back():
    with signals_held_back():
        act()

install_handlers()
for block in (act, act_held_back):
    try:
        with interruptible():
            block()
            for _ in range(2000):
                time.sleep(0.01)
    except KeyboardInterrupt:
        print("interrupted")
"""


def test_a_command_is_interrupted(tmp_path: Path) -> None:
    with start("-c", INTERRUPTED, folder=tmp_path) as process:
        stdout, stderr = process.communicate(timeout=120.0)
    assert (stdout.split("\n"), stderr) == (
        ["interrupted", "acted to the end", "interrupted", ""],
        "",
    )


WORKERS = """
from capture.batch.runner import Batch

if __name__ == "__main__":
    try:
        with Batch(workers=2, start_up_s=0.0) as batch:
            assert list(batch.map(abs, range(-9, 0))) == list(range(9, 0, -1))
            next(batch.map(abs, iter(int, 1)))  # of an endless number of zeros
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        print("interrupted")
"""


@pytest.mark.slow
def test_work_goes_to_other_processes_which_end_with_it(tmp_path: Path) -> None:
    (tmp_path / "work.py").write_text(WORKERS)
    with start("work.py", folder=tmp_path) as process:
        stdout, stderr = process.communicate(timeout=120.0)
    assert (process.returncode, stdout, stderr) == (0, "interrupted\n", "")


@pytest.mark.slow
def test_the_demo_is_made(ran: Ran, tmp_path: Path) -> None:
    ran("demo --out report")
    assert (tmp_path / "report" / "report.html").is_file()
