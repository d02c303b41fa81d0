"""Real MicroPython on Node: a bench that runs the firmware, and a Pico on a pseudo-terminal."""

import contextlib
import json
import os
import pty
import shutil
import subprocess
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import serial

from tests.suites import MICROPYTHON

HERE = Path(__file__).parent
FIRMWARE = HERE.parents[1] / "firmware_sim"
BOARD_FILES = (FIRMWARE / "firmware.py", *sorted((FIRMWARE / "pico").glob("*.py")))
# Long enough for Node to start on a busy machine.
DEADLINE_S = 60.0


def command(flash: Path, *descriptors: int) -> list[str]:
    """Return the command line of a board whose file system is the folder `flash`."""
    words = ("node", HERE / "board.mjs", MICROPYTHON / "node_modules", HERE / "fakes", flash)
    return [str(word) for word in (*words, *descriptors)]


class Bench:
    """bench.py under MicroPython; a line is a request."""

    def __init__(self, flash: Path) -> None:
        shutil.copy(HERE / "bench.py", flash / "main.py")
        shutil.copy(FIRMWARE / "firmware.py", flash)
        self._process = subprocess.Popen(
            command(flash), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def ask(self, *requests: str) -> list[str]:
        """Send requests from a thread and return their answers."""
        pipe_in, pipe_out = self._process.stdin, self._process.stdout
        assert pipe_in is not None
        assert pipe_out is not None

        def send() -> None:
            pipe_in.writelines(request + "\n" for request in requests)
            pipe_in.flush()

        sender = threading.Thread(target=send)
        sender.start()
        answers = [pipe_out.readline().strip() for _ in requests]
        sender.join()
        if "Traceback (most recent call last):" in answers:
            pytest.fail("\n".join(answers) + pipe_out.read())
        return answers

    def answers(self, *requests: str) -> list[bytes]:
        return [bytes.fromhex(answer) for answer in self.ask(*requests)]

    def close(self) -> None:
        self._process.communicate(timeout=DEADLINE_S)


class Pico:
    """MicroPython with the board file on a pseudo-terminal, its pins recorded.

    Parameters
    ----------
    flash
        The folder that is its file system.
    """

    def __init__(self, flash: Path) -> None:
        self.flash = flash
        self.records: list[dict[str, object]] = []
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(slave)
        os.close(slave)
        records, self._records_end = os.pipe()
        self._events_end, self._events = os.pipe()
        os.set_blocking(self._events_end, False)
        descriptors = (self._records_end, self._events_end)
        self._process = subprocess.Popen(
            command(flash, *descriptors),
            stdin=self._master,
            stdout=self._master,
            pass_fds=descriptors,
        )
        os.close(self._records_end)
        os.close(self._events_end)
        self._reader = threading.Thread(target=self._read, args=(records,))
        self._reader.start()

    def send_event(self, event: str) -> None:
        """Send an event to the board: `strobe 0`, `part 0`, `glitch`, `hang 3000`, `fail TEXT`."""
        os.write(self._events, event.encode() + b"\n")

    def recorded(self, what: str, since: int = 0) -> list[tuple[int, int]]:
        """Pin number and value of each record of a kind, from record `since` on."""
        return [(r["number"], r["value"]) for r in self.records[since:] if r["what"] == what]

    def mark(self) -> int:
        """Wait until all events so far are recorded, and return the number of records."""
        count = len(self.recorded("mark"))
        self.send_event("mark")
        self.wait_for("mark", count + 1)
        return len(self.records)

    def wait_for(self, what: str, count: int = 1, since: int = 0) -> None:
        deadline_s = time.monotonic() + DEADLINE_S
        while len(self.recorded(what, since)) < count:
            assert time.monotonic() < deadline_s, f"no {what} in {self.records[since:]}"
            time.sleep(0.005)

    @contextlib.contextmanager
    def prompt(self) -> Iterator[Callable[[str], str]]:
        """Open MicroPython's raw prompt: a function that executes code and returns its output."""
        with serial.Serial(self.port, timeout=DEADLINE_S) as port:

            def execute(code: str) -> str:
                port.write(code.encode() + b"\x04")
                printed, error = (port.read_until(b"\x04")[:-1].decode() for _ in range(2))
                port.read_until(b">")
                assert not error
                return printed.removeprefix("OK").strip()

            port.write(b"\x01")
            port.read_until(b"raw REPL; CTRL-B to exit\r\n>")
            yield execute
            port.write(b"\x02")

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join()
        for descriptor in (self._master, self._events):
            os.close(descriptor)

    def _read(self, records: int) -> None:
        with os.fdopen(records) as lines:
            for line in lines:
                self.records.append(json.loads(line))


@pytest.fixture(scope="session")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """The firmware under MicroPython."""
    made = Bench(tmp_path_factory.mktemp("bench"))
    yield made
    made.close()


@pytest.fixture
def new_pico(tmp_path: Path) -> Iterator[contextlib.ExitStack]:
    """A function that makes a Pico with files."""
    with contextlib.ExitStack() as stack:

        def make(*files: Path) -> Pico:
            flash = tmp_path / "flash"
            flash.mkdir()
            for file in files:
                shutil.copy(file, flash)
            pico = Pico(flash)
            stack.callback(pico.close)
            return pico

        yield make


@pytest.fixture
def pico(new_pico) -> Pico:
    """A Pico that runs the rig's files."""
    return new_pico(*BOARD_FILES)
