"""Ctrl-C and SIGTERM in the middle of a set, to a process of its own on the real clock."""

import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

RIG = """
[lights]
port = "simulated"
[camera]
width_px = 64
height_px = 64
frame_rate_hz = 1
[simulation]
clock = "real"
"""


def lights_are_open(pid: int) -> bool:
    """Whether the process holds a pty's slave side: the driver has opened its port."""
    descriptors = []
    for link in Path(f"/proc/{pid}/fd").iterdir():
        try:
            descriptors.append(str(link.readlink()))
        except OSError:
            continue
    return any(target.removeprefix("/dev/pts/").isdigit() for target in descriptors)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_mid_set_is_one_line_and_leaves_no_file(
    spawn: Callable[..., Any], tmp_path: Path, number: signal.Signals
) -> None:
    config = tmp_path / "rig.toml"
    config.write_text(RIG)
    folder = tmp_path / "sets"
    folder.mkdir()
    process = spawn("capture", "--rig", config, folder / "a.ome.tif")
    deadline_s = time.monotonic() + 20.0
    while not lights_are_open(process.pid):
        assert process.poll() is None
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
    time.sleep(0.5)  # a set takes 5 s at 1 Hz
    started_s = time.monotonic()
    process.send_signal(number)
    stdout, stderr = process.communicate(timeout=20)
    assert time.monotonic() - started_s < 2.0
    assert (process.returncode, stdout, stderr) == (130, "", "ps4rig: interrupted\n")
    assert list(folder.iterdir()) == []
