"""The test driver vivid, opened as a device, as a camera and as a rig."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from firmware_sim import RealClock, SimulatedBoard, SimulatedController, serve_pty
from rig import Rig, RigConfig, open_rig
from rig.config.camera import CameraConfig
from rig.v4l2.camera import V4l2Camera
from rig.v4l2.controls import write_control
from rig.v4l2.device import V4l2Device
from tests.hil.guest.vivid_bench import (
    SETTLE_MS,
    VIDEO,
    Bench,
    config,
    named,
    opencv_config,
)


@pytest.fixture
def camera() -> Iterator[V4l2Camera]:
    opened = V4l2Camera(config())
    yield opened
    opened.close()


@pytest.fixture
def device() -> Iterator[V4l2Device]:
    opened = V4l2Device(VIDEO)
    yield opened
    opened.close()


@contextmanager
def opened_bench(camera: CameraConfig) -> Iterator[Bench]:
    clock = RealClock()
    board = SimulatedBoard(clock)
    with serve_pty(SimulatedController(board, clock)) as server:
        lights = {
            "port": server.address,
            "settle_ms": SETTLE_MS,
            # Three: four pictures that shade nothing contradict each other. And unequal as the
            # brightness steps, or the set would be refused for that.
            "tilts_deg": [0, 120, 240],
            "intensities": [1, 2, 3],
        }
        whole = RigConfig.model_validate({"lights": lights, "camera": camera.model_dump()})
        with open_rig(whole) as opened:
            yield Bench(opened, board)


@pytest.fixture
def bench() -> Iterator[Bench]:
    with opened_bench(config()) as bench:
        yield bench


@pytest.fixture
def opencv_bench() -> Iterator[Bench]:
    with opened_bench(opencv_config()) as bench:
        yield bench


@pytest.fixture(params=["v4l2", "opencv"])
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    """Of the camera contract."""
    with opened_bench(config() if request.param == "v4l2" else opencv_config()) as bench:
        yield bench.rig


@pytest.fixture(scope="module")
def no_caption() -> None:
    device = V4l2Device(VIDEO)
    write_control(device, named(device, "osd_text_mode"), 2)
    device.close()
