"""The simulated rig as devices of the guest."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

import capture.cli  # noqa: F401 - for the programs
from capture.__main__ import main

from .serial_bench import GADGET, wait_for

VIDEO = "/dev/video9"
SHARED = Path("/mnt")
SIDE_PX = 128
RATE_HZ = 5.0
PERIOD_S = 1.0 / RATE_HZ
EXPOSURE_MS = 20.0
SETS = 2
# The part: another patch of the surface than the library is trained on, and rotated.
SURFACE, SEED, ROTATE_DEG = "sand", 7, 40.0
HOT_PIXELS = 6


def rig_toml(pixel_format: str = "Y16") -> str:
    """An ordinary rig; the camera's last two keys describe v4l2loopback."""
    return f"""
name = "closed loop"

[lights]
port = "auto"
serial_number = "{GADGET}"
settle_ms = 20

[camera]
kind = "v4l2"
device = "{VIDEO}"
pixel_format = "{pixel_format}"
width_px = {SIDE_PX}
height_px = {SIDE_PX}
frame_rate_hz = {RATE_HZ:g}
exposure_ms = {EXPOSURE_MS:g}
readout_ms = 4
fixed_exposure = true
timestamp_marks = "writer"
"""


class ForkedProgram:
    """A ``ps4rig`` that shares the imports of this process.

    An interpreter of its own would take the guest half a minute to start.
    """

    def __init__(self, *arguments: object) -> None:
        self._stdout, self._stderr = os.memfd_create("stdout"), os.memfd_create("stderr")
        self.process = get_context("fork").Process(target=self._run, args=arguments)
        self.process.start()

    def _run(self, *arguments: object) -> None:
        os.dup2(self._stdout, 1)
        os.dup2(self._stderr, 2)
        sys.argv = ["ps4rig", *map(str, arguments)]
        main()

    def printed(self) -> str:
        """All of its standard output."""
        return _text_in(self._stdout)

    def end(self) -> tuple[int | None, str]:
        """Wait for its end; return the exit status and what it printed to standard error."""
        self.process.join()
        return self.process.exitcode, _text_in(self._stderr)


def _text_in(file: int) -> str:
    return os.pread(file, 1 << 16, 0).decode()


@contextmanager
def simulated_rig(config: Path, serial: str, surface: str = SURFACE) -> Iterator[ForkedProgram]:
    """Run ``ps4rig rig simulate`` as a process, and end it with Ctrl-C."""
    program = ForkedProgram(
        *("rig", "simulate", "--rig", config, "--serial", serial, "--camera", f"v4l2:{VIDEO}"),
        *("--surface", surface, "--seed", SEED, "--rotate", ROTATE_DEG),
    )
    try:
        wait_for(lambda: program.printed().count("\n") == 2 or not program.process.is_alive())
        lights, camera = program.printed().splitlines()
        assert lights == f"lights: {serial}"
        assert camera.startswith(f"camera: v4l2:{VIDEO}, Y16 {SIDE_PX}x{SIDE_PX}"), camera
        yield program
    finally:
        if program.process.is_alive():
            os.kill(program.process.pid, signal.SIGINT)
        program.end()
