"""``ps4rig rig simulate`` on a serial line of two ptys; tests/hil tests the frames."""

import os
import select
import signal
import subprocess
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rig.lights.driver import LightController

Refused = Callable[..., str]
Spawn = Callable[..., "subprocess.Popen[str]"]


@contextmanager
def null_modem() -> Iterator[tuple[str, str]]:
    """Two connected serial devices."""
    pairs = [os.openpty() for _ in range(2)]
    (near, near_end), (far, far_end) = pairs
    for _, end in pairs:
        tty.setraw(end)
    unplug, unplugged = os.pipe()

    def carry() -> None:
        while True:
            ready, _, _ = select.select([near, far, unplug], [], [])
            if unplug in ready:
                return
            for side in ready:
                os.write(far if side == near else near, os.read(side, 256))

    cable = threading.Thread(target=carry)
    cable.start()
    try:
        yield os.ttyname(near_end), os.ttyname(far_end)
    finally:
        os.write(unplugged, b"x")
        cable.join()
        for fd in (unplug, unplugged, *(fd for pair in pairs for fd in pair)):
            os.close(fd)


@pytest.mark.slow
def test_the_firmware_answers_on_a_serial_device_until_ctrl_c(spawn: Spawn) -> None:
    with null_modem() as (port, far_end):
        process = spawn("rig", "simulate", "--size", 32, "--serial", far_end)
        assert process.stdout.readline() == f"lights: {far_end}\n"
        with LightController(port) as lights:
            assert lights.select(2).led == 2
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=120)
    assert (process.returncode, stderr) == (0, "no LED lit\n")


def test_the_error_for_a_missing_device_names_the_options(refused: Refused) -> None:
    line = refused("rig", "simulate")
    assert "--serial DEV" in line
    assert "--camera v4l2:DEV, of v4l2loopback (modprobe v4l2loopback makes one) or" in line


@pytest.mark.parametrize("camera", ["/dev/video9", "opencv:0", "v4l2:"])
def test_a_camera_without_kind_or_place_gets_the_choices(refused: Refused, camera: str) -> None:
    assert f"--camera {camera}: give v4l2:DEV" in refused("rig", "simulate", "--camera", camera)


@pytest.mark.parametrize(
    ("options", "cause"),
    [
        (("--serial", "missing"), "No such file"),
        (("--camera", "v4l2:missing"), "missing: no such camera"),
        (("--camera", "v4l2:/dev/null"), "/dev/null: is no"),
    ],
)
@pytest.mark.usefixtures("in_folder")
def test_a_device_that_cannot_be_used_is_named(
    refused: Refused, options: tuple[str, ...], cause: str
) -> None:
    assert cause in refused("rig", "simulate", "--size", "32", *options, status=3)


def test_a_pixel_format_that_cannot_be_written_is_named(refused: Refused, tmp_path: Path) -> None:
    config = tmp_path / "rig.toml"
    config.write_text(
        '[lights]\nport = "/dev/ttyACM0"\n'
        '[camera]\nkind = "v4l2"\ndevice = "0"\npixel_format = "SRGGB8"\n'
    )
    line = refused("rig", "simulate", "--rig", config, "--camera", "v4l2:/dev/video9")
    assert "camera.pixel_format = 'SRGGB8'" in line
