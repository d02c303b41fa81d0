"""Runs of stations in forked processes, which may be killed.

A forked process shares the imports of this one, so that a run starts in a tenth of a second. It is
killed like any other process.
"""

import json
import os
import select
import signal
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from capture.station.run.live_view import LiveEvent
from tests.capture.station.production import run_parts

# A run without an event for so long hangs. Machines stand still for minutes, too.
_SILENCE_S = 900.0


@dataclass
class ForkedRun:
    """A run in a process of its own, and the events that it printed."""

    process: int
    pipe: int
    events: list[dict[str, Any]] = field(default_factory=list)
    is_over: bool = False
    status: int | None = None
    _rest: bytes = b""

    @classmethod
    def start(cls, folder: Path, parts: int | None = None) -> "ForkedRun":
        """Fork, and run the station in the new process."""
        reading, writing = os.pipe()
        process = os.fork()
        if process == 0:
            os.close(reading)
            _be_the_run(folder, parts, writing)
        os.close(writing)
        return cls(process, reading)

    def read(self, timeout_s: float) -> None:
        """Read what has been printed, or wait for more."""
        if not select.select([self.pipe], [], [], timeout_s)[0]:
            return
        block = os.read(self.pipe, 1 << 16)
        self.is_over = not block
        *lines, self._rest = (self._rest + block).split(b"\n")
        self.events += [json.loads(line) for line in lines]

    def announced(self) -> int:
        return sum(event["event"] == "part" for event in self.events)

    def read_until(self, parts: int) -> None:
        """Read until so many parts are announced, or the run is over."""
        heard_s, known = time.monotonic(), -1
        while not self.is_over and self.announced() < parts:
            self.read(1.0)
            if len(self.events) != known:
                heard_s, known = time.monotonic(), len(self.events)
            assert time.monotonic() - heard_s < _SILENCE_S, "the run hangs"

    def kill(self) -> None:
        os.kill(self.process, signal.SIGKILL)
        self.wait()

    def wait(self) -> int:
        """Read the rest, and return the exit status."""
        while not self.is_over:
            self.read(_SILENCE_S)
        os.close(self.pipe)
        self.status = os.waitpid(self.process, 0)[1]
        return self.status


def _be_the_run(folder: Path, parts: int | None, writing: int) -> None:
    def tell(live: LiveEvent) -> None:
        os.write(writing, live.as_json.encode() + b"\n")

    status = 1
    try:
        run_parts(folder, parts, tell)
        status = 0
    except BaseException as error:
        os.write(2, f"{folder.name}: {error!r}\n".encode())
    finally:
        os._exit(status)
