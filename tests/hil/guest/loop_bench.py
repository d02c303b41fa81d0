"""The simulated rig as devices of the guest."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .serial_bench import GADGET

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


def ps4rig(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "capture", *map(str, arguments)]


@contextmanager
def simulated_rig(
    config: Path, serial: str, surface: str = SURFACE
) -> Iterator[subprocess.Popen[str]]:
    """Run ``ps4rig rig simulate`` as a process, and end it with Ctrl-C."""
    command = ps4rig(
        *("rig", "simulate", "--rig", config, "--serial", serial, "--camera", f"v4l2:{VIDEO}"),
        *("--surface", surface, "--seed", SEED, "--rotate", ROTATE_DEG),
    )
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            said = [process.stdout.readline() for _ in range(2)]
            assert said[0] == f"lights: {serial}\n", process.stderr.read()
            assert said[1].startswith(f"camera: v4l2:{VIDEO}, Y16 {SIDE_PX}x{SIDE_PX}"), said
            yield process
        finally:
            process.send_signal(signal.SIGINT)
