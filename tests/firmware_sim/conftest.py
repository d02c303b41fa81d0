"""A simulated device on virtual time."""

from collections.abc import Callable
from dataclasses import dataclass

import pytest

from firmware_sim import SimulatedBoard, SimulatedController, VirtualClock


@dataclass(frozen=True)
class Device:
    clock: VirtualClock
    board: SimulatedBoard
    controller: SimulatedController

    def exchange(self, data: bytes) -> bytes:
        self.controller.feed(data)
        return self.controller.take_output()

    def strobe(self, exposing: bool) -> None:
        self.board.strobe(exposing, self.clock.now_s())

    def lit(self) -> list[float]:
        """The output of each LED, once it has settled."""
        self.clock.sleep_s(0.05)
        now_s = self.clock.now_s()
        return [round(self.board.output(led, now_s), 9) for led in range(self.board.led_count)]


def _new_device(max_on_ms: int = 120_000, **options: object) -> Device:
    clock = VirtualClock()
    board = SimulatedBoard(clock, max_on_ms=max_on_ms)
    controller = SimulatedController(board, clock, **options)
    clock.on_tick(controller.poll)
    return Device(clock, board, controller)


@pytest.fixture(scope="session")
def new_device() -> Callable[..., Device]:
    """Make a device whose banner has not been read."""
    return _new_device


@pytest.fixture
def device() -> Device:
    """A device whose banner has been read."""
    made = _new_device()
    made.controller.take_output()
    return made
