"""The test driver vivid as a camera whose brightness follows the LEDs."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import pytest

from firmware_sim import SimulatedBoard
from rig import CameraError, Frame, Rig
from rig.cameras.opencv import OpencvCameraConfig
from rig.cameras.v4l2.camera import V4l2Camera
from rig.cameras.v4l2.controls import (
    Control,
    list_controls,
    read_control,
    write_control,
)
from rig.cameras.v4l2.device import V4l2Device
from rig.cameras.v4l2.measurement_mode import V4l2CameraConfig

VIDEO = "/dev/video0"
DISCONNECTED = "/dev/video1"
REMOVED = "/dev/video2"
RATE_HZ = 10.0
PERIOD_S = 1.0 / RATE_HZ
# The time-out of a read, and some time for an emulated processor that pauses.
DEADLINE_S = 6.0
# For a frame that was being filled, and for the thread that sets the brightness.
SETTLE_MS = 60.0
# Within vivid's range: beyond it the grey values of its bars wrap round.
AMBIENT, STEP = 128, 12
CID_GAIN = 0x980913
CID_BRIGHTNESS = 0x980900
_CAMERA = {"width_px": 320, "height_px": 180, "exposure_ms": 20.0, "fixed_exposure": True}


def config(
    pixel_format: str = "GREY",
    device: str = VIDEO,
    frame_rate_hz: float = RATE_HZ,
    **changes: object,
) -> V4l2CameraConfig:
    values = _CAMERA | {
        "kind": "v4l2",
        "device": device,
        "pixel_format": pixel_format,
        "frame_rate_hz": frame_rate_hz,
        # A frame is filled at some time in the period before its stamp.
        "readout_ms": 1000.0 / frame_rate_hz,
    }
    return V4l2CameraConfig.model_validate(values | changes)


def opencv_config(**changes: object) -> OpencvCameraConfig:
    values = _CAMERA | {"kind": "opencv", "device": VIDEO, "frame_rate_hz": RATE_HZ}
    return OpencvCameraConfig.model_validate(values | changes)


def assert_fails_in_time(camera: V4l2Camera, message: str) -> None:
    """Read more frames than the driver buffers, until the camera fails."""
    started_s = time.monotonic()
    with pytest.raises(CameraError, match=message):
        [camera.read(2.0) for _ in range(6)]
    assert time.monotonic() - started_s < DEADLINE_S


def without_loss(camera: V4l2Camera, count: int) -> list[Frame]:
    """Read frames without a gap; starts again where an emulated machine has lost one."""
    frames: list[Frame] = []
    for _ in range(10 * count):
        frame = camera.read(2.0)
        if frames and frame.sequence != frames[-1].sequence + 1:
            frames = []
        frames.append(frame)
        if len(frames) == count:
            return frames
    raise AssertionError(f"never {count} frames in a row without a gap")


def mean_period_s(frames: list[Frame]) -> float:
    """The mean period of frames in a row; a busy host delays single ones by 20 ms and more."""
    starts_s = [frame.exposure_start_s for frame in frames]
    assert starts_s == sorted(set(starts_s))
    return (starts_s[-1] - starts_s[0]) / (len(frames) - 1)


def named(device: V4l2Device, slug: str) -> Control:
    return next(control for control in list_controls(device) if control.slug == slug)


@contextmanager
def control_set(device: V4l2Device, slug: str, value: int) -> Iterator[None]:
    """Set a control, and set it back afterwards."""
    control = named(device, slug)
    before = read_control(device, control)
    write_control(device, control, value)
    try:
        yield
    finally:
        write_control(device, control, before)


def press(device: V4l2Device, slug: str) -> None:
    write_control(device, named(device, slug), 0)


@dataclass(frozen=True)
class Bench:
    """A rig of vivid and the firmware on a pty, and the board with its LEDs."""

    rig: Rig
    board: SimulatedBoard


@contextmanager
def brightness_follows_the_leds(bench: Bench) -> Iterator[None]:
    """Raise vivid's brightness while an LED is on, because vivid sees no light.

    Each LED raises it by another amount, so that an image tells its light.
    """
    camera = bench.rig.camera
    # V4l2Camera keeps other files from changing controls, so its own is used.
    device = camera._device if isinstance(camera, V4l2Camera) else V4l2Device(VIDEO)
    brightness = named(device, "brightness")
    done = threading.Event()

    def follow() -> None:
        held = None
        while not done.wait(0.002):
            now_s = bench.rig.clock.now_s()
            lit = [bench.board.output(led, now_s) > 0.5 for led in range(4)]
            level = AMBIENT + sum(STEP * (led + 1) for led in range(4) if lit[led])
            if level != held:
                write_control(device, brightness, level)
                held = level

    thread = threading.Thread(target=follow)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        write_control(device, brightness, AMBIENT)
