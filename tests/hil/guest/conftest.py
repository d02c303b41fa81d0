"""Fixtures that open the test driver vivid as a device, a camera and a rig."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from firmware_sim import RealClock, SimulatedBoard, SimulatedController, serve_pty
from rig import Rig, RigConfig, open_rig
from rig.cameras.config import CameraConfig
from rig.cameras.v4l2.camera import V4l2Camera
from rig.cameras.v4l2.controls import write_control
from rig.cameras.v4l2.device import V4l2Device
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
            # Three lights, because four images without shading contradict each other. Unequal, as
            # the steps of brightness are, or the set would be rejected for that.
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
    """The rig of the camera contract."""
    with opened_bench(config() if request.param == "v4l2" else opencv_config()) as bench:
        yield bench.rig


@pytest.fixture(scope="module")
def no_caption() -> None:
    device = V4l2Device(VIDEO)
    write_control(device, named(device, "osd_text_mode"), 2)
    device.close()
