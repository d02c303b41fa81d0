"""Signals that end a command, during its start-up and during a set."""

import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

Run = Callable[..., str]
Spawn = Callable[..., Any]
INTERRUPTED = (130, "", "ps4rig: interrupted\n")
DEADLINE_S = 300.0
RIG = """
[lights]
port = "simulated"
watchdog_ms = 60000
[camera]
width_px = 64
height_px = 64
frame_rate_hz = 0.2
[simulation]
clock = "real"
"""
PROGRAM = """
import signal, sys, threading
import llvmlite.binding as llvm
from capture.base.interrupts import install_handlers, interruptible

def compile(notify):
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    module = llvm.parse_assembly("define i32 @one() {{ ret i32 1 }}")
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(module, machine)
    engine.set_object_cache(notify)
    engine.finalize_object()

install_handlers()
try:
    with interruptible():
        {block}
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.fixture
def slow_capture(spawn: Spawn, tmp_path: Path) -> Callable[[], Any]:
    """Start a capture of 25 seconds that writes to tmp_path/sets only."""
    config = tmp_path / "rig.toml"
    config.write_text(RIG)
    (tmp_path / "sets").mkdir()
    return lambda: spawn("capture", "--rig", config, tmp_path / "sets" / "a.ome.tif")


def wait_until(condition: Callable[[int], bool], process: Any) -> None:
    deadline_s = time.monotonic() + DEADLINE_S
    while not condition(process.pid):
        assert process.poll() is None
        assert time.monotonic() < deadline_s


def handles_sigterm(pid: int) -> bool:
    """Whether the process has installed its handlers: Python itself has none for SIGTERM."""
    caught = Path(f"/proc/{pid}/status").read_text().split("SigCgt:")[1].split()[0]
    return bool(int(caught, 16) >> (signal.SIGTERM - 1) & 1)


def has_opened_lights(pid: int) -> bool:
    """Whether the process has both ends of the line to its simulated controller, and its port."""
    sockets = 0
    for link in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(OSError):  # closed since
            sockets += str(link.readlink()).startswith("socket:")
    return sockets == 3


@pytest.mark.slow
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT"])
def test_a_signal_during_a_set_is_one_line_and_leaves_no_file(
    slow_capture: Callable[[], Any], tmp_path: Path, number: str
) -> None:
    process = slow_capture()
    wait_until(has_opened_lights, process)
    process.send_signal(signal.Signals[number])
    stdout, stderr = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, stdout, stderr) == INTERRUPTED
    assert list((tmp_path / "sets").iterdir()) == []


@pytest.mark.slow
def test_a_signal_at_any_moment_of_the_start_is_one_line(
    slow_capture: Callable[[], Any], tmp_path: Path
) -> None:
    moments = random.Random(11)
    for _ in range(24):
        process = slow_capture()
        wait_until(handles_sigterm, process)
        time.sleep(moments.uniform(0.0, 1.0))  # any delay is good: the capture takes 25 seconds
        process.send_signal(moments.choice([signal.SIGINT, signal.SIGTERM]))
        stdout, stderr = process.communicate(timeout=DEADLINE_S)
        assert (process.returncode, stdout, stderr) == INTERRUPTED
        assert list((tmp_path / "sets").iterdir()) == []


@pytest.mark.parametrize("module", ["typer", "tifffile"])
def test_an_interrupt_that_an_import_would_swallow_ends_the_process(
    spawn: Spawn, sets: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str
) -> None:
    """A fake module catches the interrupt of its import and then loads the real module."""
    (tmp_path / f"{module}.py").write_text(
        "import signal, sys\n"
        "try:\n    signal.raise_signal(signal.SIGINT)\nexcept BaseException:\n    pass\n"
        f"sys.path.remove({str(tmp_path)!r})\n"
        f"del sys.modules[{module!r}]\nimport {module}\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    process = spawn("solve", sets / "rock-001.ome.tif", "--out", tmp_path / "maps")
    stdout, stderr = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, stdout, stderr) == INTERRUPTED
    assert not (tmp_path / "maps").exists()


@pytest.mark.parametrize(
    ("block", "stdout"),
    [
        ("signal.raise_signal(signal.SIGQUIT)", "interrupted\n"),
        # A second signal does not disturb the clean-up after the first.
        (
            """try: signal.raise_signal(signal.SIGINT)
        finally: signal.raise_signal(signal.SIGTERM); print('cleaned up')""",
            "cleaned up\ninterrupted\n",
        ),
        # The compiler reports its code to a callback, in which every exception is swallowed. The
        # interrupt that comes later ends a wait.
        (
            """compile(lambda *_: signal.raise_signal(signal.SIGINT)); threading.Event().wait()""",
            "interrupted\n",
        ),
        # The destructor of an object that is half made fails.
        (
            """type("Half", (), dict(
            __init__=lambda self: signal.raise_signal(signal.SIGINT),
            __del__=lambda self: self.value,
        ))()""",
            "interrupted\n",
        ),
    ],
)  # fmt: skip
def test_a_command_is_interrupted_once(run_python: Run, block: str, stdout: str) -> None:
    assert run_python(PROGRAM.format(block=block)) == stdout


def test_a_signal_after_a_command_ends_the_process() -> None:
    program = PROGRAM.format(block="pass") + "signal.raise_signal(signal.SIGTERM)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == INTERRUPTED


def test_signals_that_the_parent_ignores_stay_ignored(run_python: Run) -> None:
    block = "signal.raise_signal(signal.SIGHUP); print('goes on')"
    assert run_python(PROGRAM.format(block=block), before=("nohup",)) == "goes on\n"
