"""Every light controller and every camera that the contracts are run on."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest

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
from rig.lights import LightController


@dataclass(frozen=True)
class LightsUnderTest:
    """A served controller, how to open it, and a view of what its LEDs really do."""

    clock: Clock
    board: SimulatedBoard
    server: Server

    def open(self, **options: int) -> LightController:
        return LightController(self.server.address, clock=self.clock, **options)

    def lit(self) -> list[int]:
        self.clock.sleep_s(0.02)
        now_s = self.clock.now_s()
        return [led for led in range(4) if self.board.output(led, now_s) > 1e-6]


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


@pytest.fixture(params=["virtual", "real"])
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    config = RigConfig().with_changes(
        camera={"width_px": 48, "height_px": 32, "frame_rate_hz": 100.0, "exposure_ms": 5.0},
        simulation={"clock": request.param},
    )
    with open_rig(config) as opened:
        yield opened
