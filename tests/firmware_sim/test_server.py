"""The simulated controller on real terminals and sockets, from the host's side."""

import os
import select
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from unittest import mock

import pytest
import serial

from firmware_sim import (
    RealClock,
    Server,
    SimulatedBoard,
    SimulatedController,
    VirtualClock,
    serve_local,
    serve_pty,
    serve_tcp,
    serve_tty,
    serve_unix,
    terminals,
)
from tests.waiting import until_so

IDENTITY = b"PS4RIG,LED4,SIM-0001,2.1.0,2\n"
BANNER = b"READY " + IDENTITY
OK_IDENTITY = b"OK " + IDENTITY


def controller(clock=None, **options) -> SimulatedController:
    clock = clock or VirtualClock()
    options.setdefault("link_delay_ms", 0.0)
    return SimulatedController(SimulatedBoard(clock), clock, **options)


def until_host_is_gone(server: Server) -> None:
    """Wait until the server of a pty, which looks now and then, has seen that no host is there."""
    until_so(lambda: not getattr(server._endpoint, "_was_open", False))


@contextmanager
def opened(server: Server, address: str = "") -> Iterator[serial.Serial]:
    """Open as a host does: a pyserial URL, or a device path exclusively."""
    address = address or server.address
    exclusive = {} if address.startswith("socket:") else {"exclusive": True}
    # A host that is slow would discard the banner of a board that is not.
    with mock.patch.object(serial.Serial, "_reset_input_buffer"):
        host = serial.serial_for_url(address, timeout=60.0, write_timeout=60.0, **exclusive)
    with host as port:
        yield port
    until_host_is_gone(server)


def ask(port: serial.Serial, line: bytes) -> bytes:
    port.write(line + b"\n")
    return port.read_until(b"\n")


def test_a_unix_socket_is_served_and_removed(tmp_path):
    path = tmp_path / "led.sock"
    with serve_unix(controller(), path) as server:
        assert server.address == str(path)
        with connected(path) as host:
            assert ask_socket(host, b"*IDN?\n") == OK_IDENTITY
        with pytest.raises(OSError, match="in use"):
            serve_unix(controller(), path)
    assert not path.exists()


@contextmanager
def null_modem() -> Iterator[tuple[int, str]]:
    """The host's descriptor of a serial line, and the device at its other end."""
    host, device = os.openpty()
    try:
        yield host, os.ttyname(device)
    finally:
        os.close(device)
        os.close(host)


def test_a_serial_device_is_served_raw_and_locked():
    with null_modem() as (host, path), serve_tty(controller(), path, 9600) as server:
        assert server.address == path
        os.write(host, b"*IDN?\n")
        # Raw: no echo of the command, no carriage return.
        assert os.read(host, 100) == OK_IDENTITY
        # The kernel lets the superuser in, who then finds the lock; others are busy at once.
        with pytest.raises(OSError, match=r"unavailable|busy"):
            serve_tty(controller(), path)


def test_a_serial_device_that_is_unplugged_is_served_again_when_it_is_back(tmp_path):
    link = tmp_path / "gadget"
    with null_modem() as (_, path):
        link.symlink_to(path)
        server = serve_tty(controller(), link)
    with server, null_modem() as (host, path):
        time.sleep(0.03)  # without a device
        link.unlink()
        link.symlink_to(path)
        received = b""
        deadline_s = time.monotonic() + 60.0
        while OK_IDENTITY not in received:
            assert time.monotonic() < deadline_s
            os.write(host, b"*IDN?\n")
            while select.select([host], [], [], 0.2)[0]:
                received += os.read(host, 100)


@pytest.mark.parametrize("path", ["missing", "file"])
def test_a_path_without_a_serial_device_is_refused(tmp_path, path):
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match=r"No such file|Inappropriate ioctl"):
        serve_tty(controller(), tmp_path / path)


def test_an_unknown_speed_is_refused():
    with pytest.raises(ValueError, match="12345 baud"), null_modem() as (_, path):
        serve_tty(controller(), path, 12345)


@contextmanager
def connected(path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX) as host:
        host.settimeout(60.0)
        host.connect(str(path))
        yield host


def ask_socket(host: socket.socket, data: bytes) -> bytes:
    host.sendall(data)
    with host.makefile("rb") as lines:
        return lines.readline()


def test_tcp_listens_on_loopback_only_and_for_one_client():
    with serve_tcp(controller()) as server:
        assert server.address.startswith("socket://127.0.0.1:")
        with opened(server) as port:
            assert ask(port, b"*IDN?") == OK_IDENTITY
            tcp_port = int(server.address.rpartition(":")[2])
            with socket.create_connection(("127.0.0.1", tcp_port), timeout=60.0) as second:
                assert second.recv(10) == b"", "closed at once"
            assert ask(port, b"*IDN?") == OK_IDENTITY
        with pytest.raises(OSError, match="in use"):
            serve_tcp(controller(), tcp_port)


def test_a_pty_is_held_exclusively():
    with serve_pty(controller()) as server, opened(server):  # noqa: SIM117
        with pytest.raises(serial.SerialException), opened(server):
            pass


def test_each_host_finds_a_raw_terminal_without_old_replies():
    with serve_pty(controller()) as server:
        for _ in range(2):
            # Unlike pyserial, a plain open sets nothing up.
            with open(server.address, "r+b", buffering=0) as host:  # noqa: PTH123
                host.write(b"*IDN?\n")
                assert host.readline() == OK_IDENTITY
                host.write(b"*IDN?\n")
                select.select([host], [], [], 60.0)  # for the reply that is never read
            until_host_is_gone(server)
            with opened(server) as port:
                assert ask(port, b"*RST") == b"OK\n"
                port.timeout = 0.02
                assert port.read(1) == b""


@pytest.mark.parametrize("clock_type", [RealClock, VirtualClock])
def test_opening_the_port_resets_the_board(clock_type):
    device = controller(clock_type(), resets_on_open=True, boot_ms=50.0)
    with serve_pty(device) as server:
        for _ in range(2):
            with opened(server) as port:
                assert port.read_until(b"\n") == BANNER
                assert ask(port, b"LED:STAT?").startswith(b"OK -1,")
                assert ask(port, b"LED:SEL 1").startswith(b"OK 1,")


def test_bytes_sent_while_the_board_boots_are_lost():
    device = controller(RealClock(), resets_on_open=True, boot_ms=100.0)
    with serve_pty(device) as server, opened(server) as port:
        port.write(b"LED:SEL 1\n")
        assert port.read_until(b"\n") == BANNER
        assert ask(port, b"LED:STAT?").startswith(b"OK -1,")


def test_an_exchange_is_quick():
    with serve_pty(controller(RealClock())) as server, opened(server) as port:
        ask(port, b"*IDN?")

        def exchange_s() -> float:
            start_s = time.perf_counter()
            ask(port, b"LED:STAT?")
            return time.perf_counter() - start_s

        # Exchanges that wait for the server's poll interval would take milliseconds. On a busy
        # machine some stretch of 20 exchanges is undisturbed.
        assert any(median(exchange_s() for _ in range(20)) < 0.001 for _ in range(50))


def test_without_a_free_terminal_a_port_of_this_machine_is_served(monkeypatch):
    with serve_local(controller()) as server:
        assert server.address.startswith("/dev/pts/")

    def no_terminal():
        raise OSError("out of pty devices")

    monkeypatch.setattr(terminals, "openpty", no_terminal)
    with serve_local(controller()) as server, opened(server) as port:
        assert server.address.startswith("socket://127.0.0.1:")
        assert ask(port, b"*IDN?") == OK_IDENTITY


@pytest.mark.parametrize("serve", [serve_pty, serve_tcp])
def test_a_host_that_never_reads_blocks_nothing(serve):
    with serve(controller()) as server:
        with opened(server) as port:
            for _ in range(20):
                port.write(b"*IDN?\n" * 1000)
        with opened(server) as port:
            # The empty line ends a half line of the previous host. A busy server drops what comes
            # before it notices the new host, so the request is repeated.
            port.timeout = 1.0
            answered = (port.write(b"\n*RST\n") and b"OK\n" in iter(port.readline, b"")
                        for _ in range(60))  # fmt: skip
            assert any(answered)


@pytest.mark.parametrize("serve", [serve_pty, serve_tcp])
def test_stop_unplugs_the_device(serve):
    before = set(threading.enumerate())
    clock = VirtualClock()
    board = SimulatedBoard(clock)
    server = serve(SimulatedController(board, clock))
    with opened(server) as port:
        ask(port, b"LED:SEL 1")
        server.stop()
        server.stop()
        with pytest.raises(serial.SerialException):
            ask(port, b"*IDN?")
    clock.sleep_s(0.05)
    assert board.output(1, clock.now_s()) < 1e-9
    assert set(threading.enumerate()) <= before


def test_stopped_servers_leave_no_descriptors_and_callbacks():
    clock = VirtualClock()
    device = controller(clock)
    before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
    for serve in (serve_pty, serve_tcp):
        with serve(device) as server, opened(server) as port:
            assert ask(port, b"*IDN?") == OK_IDENTITY
    assert len(os.listdir("/proc/self/fd")) == before  # noqa: PTH208
    clock.sleep_s(1.0)
    assert not clock._callbacks


def test_a_link_leads_to_the_terminal_and_is_removed(tmp_path):
    link = tmp_path / "led-controller"
    with serve_pty(controller(), link) as server:
        assert str(link.readlink()) == server.address
        with opened(server, str(link)) as port:
            assert ask(port, b"*IDN?") == OK_IDENTITY
        with pytest.raises(FileExistsError):
            serve_pty(controller(), link)
    assert not link.is_symlink()
    link.write_text("the user's file")
    with pytest.raises(FileExistsError):
        serve_pty(controller(), link)
    assert link.read_text() == "the user's file"
