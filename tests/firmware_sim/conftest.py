"""A simulated device on virtual time."""

from collections.abc import Callable
from dataclasses import dataclass

import pytest

from firmware_sim import SimulatedBoard, SimulatedController, VirtualClock
from tests.led_outputs import settled_outputs


@dataclass(frozen=True)
class Device:
    clock: VirtualClock
    board: SimulatedBoard
    controller: SimulatedController
    banner: bytes  # sent at the start

    def exchange(self, data: bytes) -> bytes:
        self.controller.feed(data)
        return self.controller.take_output()

    def ask(self, command: str) -> list[int]:
        """The numbers of the reply to a command, which must be accepted."""
        reply = self.exchange(command.encode() + b"\n").decode()
        assert reply.startswith("OK "), reply
        return [int(field) for field in reply.removeprefix("OK ").split(",")]

    def strobe(self, exposing: bool) -> None:
        self.board.strobe(exposing, self.clock.now_s())

    def see_part(self) -> None:
        self.board.see_part(self.clock.now_s())

    def lit(self) -> list[float]:
        return settled_outputs(self.clock, self.board)


def _new_device(max_on_ms: int = 120_000, **options: object) -> Device:
    clock = VirtualClock()
    board = SimulatedBoard(clock, max_on_ms=max_on_ms)
    controller = SimulatedController(board, clock, **options)
    clock.on_tick(controller.poll)
    return Device(clock, board, controller, controller.take_output())


@pytest.fixture(scope="session")
def new_device() -> Callable[..., Device]:
    """Make a device with other options."""
    return _new_device


@pytest.fixture
def device() -> Device:
    return _new_device()
