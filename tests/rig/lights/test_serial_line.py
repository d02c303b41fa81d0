"""Lines over a port, and how long they are waited for."""

import time

import pytest

from rig.lights import serial_line
from rig.lights.serial_line import ReplyTimeout, SerialLine


class StalledPort:
    """A port whose answer arrives while the program does not run."""

    def __init__(self) -> None:
        self._arriving = [b"1 O", b"", b"K\n"]

    def receive(self) -> bytes:
        time.sleep(0.2)  # much longer than a read takes in a program that runs
        return self._arriving.pop(0) if self._arriving else b""

    def write(self, data: bytes) -> object:
        return len(data)

    def close(self) -> None:
        pass


@pytest.fixture
def line(monkeypatch: pytest.MonkeyPatch) -> SerialLine:
    monkeypatch.setattr(serial_line, "open_port", lambda *_: StalledPort())
    return SerialLine("stalled", 115_200, 1.0)


@pytest.mark.slow
def test_time_in_which_the_program_did_not_run_is_not_waited_time(line: SerialLine) -> None:
    timeout = ReplyTimeout(0.4)
    assert line.read_line(timeout) == b"1 OK"
    assert 0.0 < timeout.left_s < 0.4
    assert line.read_line(timeout) is None
    assert line.read_line(timeout) is None
