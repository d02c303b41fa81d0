"""The simulated light controller on a pty, also behind a line that damages its replies."""

import os
import select
import threading
import tty
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest

from firmware_sim import Server, SimulatedBoard, SimulatedController, VirtualClock, serve_pty
from rig import RigConfig, load_config
from tests.led_outputs import settled_outputs

Tamper = Callable[[str, bytes], Iterable[bytes]]


@dataclass(frozen=True)
class Bench:
    """The simulated controller on virtual time, with its board."""

    clock: VirtualClock
    board: SimulatedBoard
    controller: SimulatedController
    server: Server

    @property
    def port(self) -> str:
        return self.server.address

    def lit(self) -> list[float]:
        return settled_outputs(self.clock, self.board)


@pytest.fixture
def bench() -> Iterator[Bench]:
    clock = VirtualClock()
    board = SimulatedBoard(clock)
    controller = SimulatedController(board, clock)
    with serve_pty(controller) as server:
        yield Bench(clock, board, controller, server)


@pytest.fixture
def load(tmp_path: Path) -> Callable[[str], RigConfig]:
    """Write a rig.toml, and load it."""
    path = tmp_path / "rig.toml"

    def written(text: str) -> RigConfig:
        path.write_text(text)
        return load_config(path)

    return written


@pytest.fixture
def served_port() -> Iterator[Callable[[str], str]]:
    """Plug in a controller with a serial number; return its port."""
    with ExitStack() as stack:

        def plug_in(serial_number: str) -> str:
            clock = VirtualClock()
            board = SimulatedBoard(clock, serial_number=serial_number)
            return stack.enter_context(serve_pty(SimulatedController(board, clock))).address

        yield plug_in


class DamagedLine:
    """A pty with the real firmware; `tamper` changes each reply.

    `tamper(command, reply)` is called once for each line of the host. Each piece that it returns is
    sent in its own write.
    """

    def __init__(self, tamper: Tamper) -> None:
        self._tamper = tamper
        self.clock = VirtualClock()
        self.board = SimulatedBoard(self.clock)
        self.controller = SimulatedController(self.board, self.clock)
        self.controller.take_output()
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stopping.set()
        self._thread.join()
        os.close(self._slave)
        os.close(self._master)

    def _run(self) -> None:
        received = b""
        while not self._stopping.is_set():
            if not select.select([self._master], [], [], 0.005)[0]:
                continue
            *lines, received = (received + os.read(self._master, 256)).split(b"\n")
            for line in lines:
                self.controller.feed(line + b"\n")
                for piece in self._tamper(line.decode(), self.controller.take_output()):
                    os.write(self._master, piece)


@pytest.fixture
def damaged_device() -> Iterator[Callable[[Tamper], DamagedLine]]:
    """Put `tamper` between the firmware and a port."""
    with ExitStack() as stack:

        def start(tamper: Tamper) -> DamagedLine:
            line = DamagedLine(tamper)
            stack.callback(line.close)
            return line

        yield start


@pytest.fixture
def damaged_line(damaged_device: Callable[[Tamper], DamagedLine]) -> Callable[[Tamper], str]:
    """Put `tamper` between the firmware and a port; return the port."""
    return lambda tamper: damaged_device(tamper).port
