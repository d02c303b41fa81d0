"""The test driver vivid, opened as a device, as a camera and as a rig."""

from collections.abc import Iterator

import pytest

from firmware_sim import RealClock, SimulatedBoard, SimulatedController, serve_pty
from rig import Rig, RigConfig, open_rig
from rig.v4l2 import V4l2Device
from rig.v4l2_camera import V4l2Camera
from rig.v4l2_controls import write_control
from tests.hil.guest.vivid_bench import SETTLE_MS, VIDEO, Bench, config, named


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


@pytest.fixture
def bench() -> Iterator[Bench]:
    clock = RealClock()
    board = SimulatedBoard(clock)
    with serve_pty(SimulatedController(board, clock)) as server:
        whole = RigConfig.model_validate(
            {
                "lights": {"port": server.address, "settle_ms": SETTLE_MS},
                "camera": config().model_dump(),
            }
        )
        with open_rig(whole) as opened:
            yield Bench(opened, board)


@pytest.fixture
def rig(bench: Bench) -> Rig:
    return bench.rig


@pytest.fixture(scope="module")
def no_caption() -> None:
    device = V4l2Device(VIDEO)
    write_control(device, named(device, "osd_text_mode"), 2)
    device.close()
