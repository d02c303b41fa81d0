"""Every light controller and every camera that the contract tests run on."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from capture import capture_set
from firmware_sim import (
    Clock,
    RealClock,
    Server,
    SimulatedBoard,
    SimulatedController,
    VirtualClock,
    serve_pty,
    serve_tcp,
)
from rig import Rig, RigConfig, open_rig
from rig.lights.driver import LightController
from tests.gige_rig import rig_of_genicam
from tests.led_outputs import settled_outputs

from .live_film import rig_of_opencv


@dataclass(frozen=True)
class LightsUnderTest:
    """A served controller, and the light that its LEDs emit."""

    clock: Clock
    board: SimulatedBoard
    server: Server

    def open(self, **options: int) -> LightController:
        return LightController(self.server.address, clock=self.clock, **options)

    def lit(self) -> list[int]:
        return [led for led, share in enumerate(settled_outputs(self.clock, self.board)) if share]


_CONTROLLERS: dict[str, tuple[type[VirtualClock | RealClock], Callable[..., Server], bool]] = {
    "pty": (VirtualClock, serve_pty, False),
    "tcp": (VirtualClock, serve_tcp, False),
    "pty, real clock": (RealClock, serve_pty, False),
    "pty, resets on open": (VirtualClock, serve_pty, True),
    "pty, resets on open, real clock": (RealClock, serve_pty, True),
}


@pytest.fixture(params=_CONTROLLERS)
def controller(request: pytest.FixtureRequest) -> Iterator[LightsUnderTest]:
    make_clock, serve, resets = _CONTROLLERS[request.param]
    clock = make_clock()
    board = SimulatedBoard(clock)
    device = SimulatedController(board, clock, resets_on_open=resets, boot_ms=100.0)
    with serve(device) as server:
        yield LightsUnderTest(clock, board, server)


CAMERA = {"width_px": 48, "height_px": 32, "frame_rate_hz": 100.0, "exposure_ms": 5.0}
# A camera that stamps frames late, and the measured timing of that camera.
LATE = {"readout_ms": 3.0, "stamp_lag_ms": 12.0}
MEASURED = {"readout_ms": 3.0, "timestamp_offset_ms": -4.0, "timestamp_uncertainty_ms": 0.2}
CAMERAS: dict[str, dict[str, dict[str, Any]]] = {
    "virtual": {},
    "real": {"simulation": {"clock": "real"}},
    "rolling, stamped late": {"simulation": LATE},
    "rolling, stamped late, measured": {"simulation": LATE, "camera": MEASURED},
    "replay": {"camera": {"kind": "replay"}},
    "replay, real": {"camera": {"kind": "replay"}, "simulation": {"clock": "real"}},
}
# Frames so large that the pipe does not hold two: fewer wait than OpenCV is assumed to buffer.
OPENCV = CAMERA | {"width_px": 64, "height_px": 64}


@pytest.fixture(scope="session")
def recorded_set(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "rock.ome.tif"
    with open_rig(RigConfig().with_changes(camera=CAMERA)) as opened:
        capture_set(opened, "rock").save(path)
    return path


GENICAM = pytest.param("genicam", marks=pytest.mark.genicam)


@pytest.fixture(params=[*CAMERAS, "opencv", GENICAM])
def rig(request: pytest.FixtureRequest, recorded_set: Path, tmp_path: Path) -> Iterator[Rig]:
    if request.param == "opencv":
        with rig_of_opencv(OPENCV, tmp_path / "film.y4m") as opened:
            yield opened
        return
    if request.param == "genicam":
        with rig_of_genicam(CAMERA | {"bits": 16, "frame_rate_hz": 30.0}) as opened:
            yield opened
        return
    changes = CAMERAS[request.param]
    camera = CAMERA | changes.get("camera", {})
    if camera.get("kind") == "replay":
        camera["set_file"] = str(recorded_set)
    config = RigConfig().with_changes(camera=camera, simulation=changes.get("simulation", {}))
    with open_rig(config) as opened:
        yield opened
