"""The driver of the light controller against the real firmware on a real pty."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from firmware_sim import (
    SimulatedBoard,
    SimulatedController,
    VirtualClock,
    crc8,
    serve_pty,
)
from rig import LightControllerError
from rig.lights.driver import LightController
from rig.lights.link import LinkTimeouts

Line = Callable[[Callable[[str, bytes], Iterable[bytes]]], str]

# Deadlines short enough to be waited for, and longer than a busy machine stands still.
SHORT = LinkTimeouts(open_s=0.4, reply_s=0.5)
# Where a test asserts that a time-out is not waited for.
SHORT_OPENING = LinkTimeouts(open_s=0.4, reply_s=60.0)


def sealed(text: str) -> bytes:
    body = text.encode()
    return body + b"~%02X\n" % crc8(body)


def sequence_of(line: str) -> str:
    return line.split()[0]


# Commands


def test_opening_puts_the_leds_out_and_forgets_levels(bench: Any) -> None:
    bench.controller.feed(b"LED:LEV 1,30\nLED:SEL 1\n")
    assert bench.lit() == [0.0, 0.3, 0.0, 0.0]
    with LightController(bench.port, clock=bench.clock) as lights:
        assert bench.lit() == [0.0] * 4
        assert lights.state().levels_percent == (100, 100, 100, 100)


def test_a_program_that_stands_still_while_it_writes_has_lost_nothing(
    bench: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = os.write

    def slow(descriptor: int, data: bytes) -> int:
        written = write(descriptor, data)
        if b"LED:STAT?" in data:
            time.sleep(0.7)  # longer than a reply is waited for
        return written

    with LightController(bench.port, clock=bench.clock) as lights:
        monkeypatch.setattr("serial.serialposix.os.write", slow)
        assert lights.state().led is None


# Closing


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_any_exception_puts_the_leds_out(bench: Any, error: type[BaseException]) -> None:
    def fail_while_lit() -> None:
        with LightController(bench.port, clock=bench.clock) as lights:
            lights.select(1)
            raise error

    with pytest.raises(error):
        fail_while_lit()
    assert bench.lit() == [0.0] * 4


def test_the_port_is_free_again_after_a_failed_opening(bench: Any) -> None:
    with pytest.raises(LightControllerError, match="no answer in 0 s"):
        LightController(bench.port, clock=bench.clock, timeouts=LinkTimeouts(open_s=0.0))
    with LightController(bench.port, clock=bench.clock) as lights:
        assert lights.select(0).led == 0


# The port


def test_a_second_opener_gets_the_error_port_in_use(bench: Any) -> None:
    with LightController(bench.port, clock=bench.clock) as lights:
        with pytest.raises(LightControllerError, match="in use by another"):
            LightController(bench.port, clock=bench.clock)
        assert lights.select(1).led == 1


_AS_ANOTHER_USER = """
import os, sys
sys.path[:] = {path!r}
from firmware_sim import SimulatedBoard, SimulatedController, VirtualClock, serve_pty
from rig.lights.driver import LightController
import firmware_sim.terminals, serial, serial.serialposix
if os.getuid() == 0:
    os.setuid(65534)  # the kernel does not exclude the superuser
clock = VirtualClock()
with serve_pty(SimulatedController(SimulatedBoard(clock), clock)) as server:
    for _ in range(3):
        with LightController(server.address, clock=clock) as lights:
            lights.select(0)
            try:
                os.close(os.open(server.address, os.O_RDWR | os.O_NOCTTY))
                print("opened")
            except OSError as error:
                print(error.errno)
"""


def test_the_kernel_refuses_other_programs_until_the_port_is_closed() -> None:
    program = _AS_ANOTHER_USER.format(path=sys.path)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.stdout.split(), done.stderr) == (["16"] * 3, "")  # EBUSY, each of three times


def test_a_missing_port_is_an_error() -> None:
    with pytest.raises(LightControllerError, match=r"^/dev/ttyNONE: no such port"):
        LightController("/dev/ttyNONE")


def test_a_file_or_folder_is_refused_and_not_changed(tmp_path: Path) -> None:
    file = tmp_path / "notes.txt"
    file.write_text("mine")
    for path in (file, tmp_path):
        with pytest.raises(LightControllerError, match="a serial port"):
            LightController(str(path))
    assert file.read_text() == "mine"


@pytest.mark.parametrize("url", ["nonsense://x", "socket://127.0.0.1:1", "socket://x", "\0"])
def test_an_unusable_url_is_refused(url: str) -> None:
    with pytest.raises(LightControllerError, match="cannot be opened"):
        LightController(url)


@pytest.fixture
def bare_pty() -> Iterator[tuple[int, str]]:
    """A pty without a device: the master's descriptor and the port."""
    master, slave = os.openpty()
    yield master, os.ttyname(slave)
    os.close(slave)
    os.close(master)


def test_a_silent_port_is_refused_at_the_deadline(bare_pty: tuple[int, str]) -> None:
    started_s = time.monotonic()
    with pytest.raises(LightControllerError, match=r"no answer in 0.4 s"):
        LightController(bare_pty[1], timeouts=SHORT_OPENING)
    assert time.monotonic() - started_s < 20.0


@pytest.mark.parametrize(
    ("chatter", "message"),
    [
        (b"$GPGGA,123519,4807.038,N\r\n", "not a light controller.*GPGGA"),
        (b"\x00\xff" * 40, "512 bytes"),
        (b"#1 OK\n\n~\n~~~00\nREADY \n", "not a light controller"),
    ],
)
def test_a_port_with_other_data_is_refused_at_the_deadline(
    bare_pty: tuple[int, str], chatter: bytes, message: str
) -> None:
    master, port = bare_pty
    os.set_blocking(master, False)
    stopping = threading.Event()

    def talk() -> None:
        while not stopping.wait(0.001):
            try:
                os.write(master, chatter)
                os.read(master, 4096)
            except BlockingIOError:
                pass

    thread = threading.Thread(target=talk)
    thread.start()
    started_s = time.monotonic()
    try:
        with pytest.raises(LightControllerError, match=message):
            LightController(port, timeouts=SHORT_OPENING)
    finally:
        stopping.set()
        thread.join()
    assert time.monotonic() - started_s < 20.0


# Other devices and versions


@pytest.mark.parametrize(
    ("identity", "message"),
    [
        ("PS4RIG,LED4,SIM-0001,1.0.0,1", "version 2; renew its firmware"),
        ("PS4RIG,LED4,SIM-0001,9.0.0,3", "version 3.*; update this program"),
        ("ACME,LED4,1,1.0,1", "not a PS4RIG .*'ACME"),
        ("", "not a PS4RIG"),
    ],
)
def test_an_unsuitable_controller_is_refused_before_any_command(
    damaged_line: Line, identity: str, message: str
) -> None:
    asked: list[str] = []

    def other(command: str, reply: bytes) -> Iterator[bytes]:
        asked.append(command)
        if "*IDN?" in command:
            yield sealed(f"{sequence_of(command)} OK {identity}".rstrip())
        else:
            yield reply

    with pytest.raises(LightControllerError, match=message):
        LightController(damaged_line(other))
    assert all("IDN" in command or command == "" for command in asked)


# Replies that are damaged, late, doubled or in pieces


def only(text: str, damage: Callable[[str, bytes], Iterable[bytes]]) -> Callable[..., Any]:
    """Damage only the replies to one command."""

    def tamper(command: str, reply: bytes) -> Iterable[bytes]:
        return damage(command, reply) if text in command else [reply]

    return tamper


def test_replies_that_come_byte_by_byte_are_joined(damaged_line: Line) -> None:
    def dribble(_: str, reply: bytes) -> Iterator[bytes]:
        for index in range(len(reply)):
            time.sleep(0.0005)
            yield reply[index : index + 1]

    with LightController(damaged_line(dribble)) as lights:
        assert lights.select(2).led == 2
        assert lights.state().led == 2


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda _, reply: [reply.replace(b"OK 1", b"OK 2")], "garbled .*'LED:SEL 1'"),
        (lambda *_: [], r"no answer .*'LED:SEL 1' in 0.5 s"),
        (
            lambda command, _: [sealed(f"{sequence_of(command)} OK 3,1000")],
            "LED 1, it lit LED 3",
        ),
        (
            lambda *_: [b"READY PS4RIG,LED4,SIM-0001,2.1.0,2\n"],
            "restarted before .*'LED:SEL 1'",
        ),
    ],
    ids=["garbled", "lost", "other LED", "restart"],
)
def test_a_wrong_reply_is_an_error_and_the_next_exchange_works(
    damaged_line: Line, damage: Any, message: str
) -> None:
    with LightController(damaged_line(only("LED:SEL 1", damage)), timeouts=SHORT) as lights:
        with pytest.raises(LightControllerError, match=message):
            lights.select(1)
        assert lights.select(3).led == 3


def test_a_doubled_reply_is_used_once(damaged_line: Line) -> None:
    with LightController(damaged_line(lambda _, reply: [reply, reply])) as lights:
        for led in (0, 1, 2, 3):
            assert lights.select(led).led == led
            assert lights.state().led == led


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        *((fields, "unexpected reply") for fields in ("", " 5", " 1,2", " a,b,c", " 1,,100,7")),
        (" -1,100,900000000", "1 LED levels, it had 4"),
        (" -1,100,100,100,100,100,900000000", "5 LED levels, it had 4"),
    ],
)
def test_a_state_of_another_form_is_an_error(damaged_line: Line, fields: str, message: str) -> None:
    asked = 0

    def change(command: str, reply: bytes) -> Iterator[bytes]:
        nonlocal asked
        asked += 1
        # The driver asks once when it opens.
        yield reply if asked == 1 else sealed(f"{sequence_of(command)} OK{fields}")

    with (
        LightController(damaged_line(only("STAT?", change))) as lights,
        pytest.raises(LightControllerError, match=message),
    ):
        lights.confirm(None)


# A controller that restarts or is unplugged


def test_half_a_line_of_another_program_is_ignored() -> None:
    clock = VirtualClock()
    controller = SimulatedController(SimulatedBoard(clock), clock)
    controller.feed(b"LED:SEL ")
    with serve_pty(controller) as server, LightController(server.address, clock=clock) as lights:
        assert lights.state().led is None


def test_close_puts_the_led_out_after_an_interrupted_write(bench: Any) -> None:
    with LightController(bench.port, clock=bench.clock) as lights:
        lights.select(2)
        lights._link._line.write(b"#9 LED:S")
    assert bench.lit() == [0.0] * 4
