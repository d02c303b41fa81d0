"""Whole lines over a serial port or TCP, each within its time-out; programs that hold a port.

Bytes are collected until a line is complete; pyserial's own `readline` may return half a line.
"""

import errno
import os
import socket
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol
from urllib.parse import urlsplit

from classify.base.errors import ConfigError
from rig.errors import LightControllerError

_PROC = Path("/proc")
# Processor time after which the search ends incomplete, on a machine with very many open files.
_MAX_SEARCH_S = 1.0


@dataclass(frozen=True)
class _PortHolder:
    """A running program that has a device open."""

    pid: int
    name: str

    def __str__(self) -> str:
        return f"{self.name} (process {self.pid})"


def port_holders(device: str, proc: Path = _PROC) -> list[_PortHolder]:
    """List the programs, this one included, that have a device open; other users' may be hidden."""
    target = os.path.realpath(device)
    deadline_s = time.thread_time() + _MAX_SEARCH_S
    holders = []
    for process in sorted(proc.glob("[0-9]*"), key=lambda path: int(path.name)):
        if time.thread_time() > deadline_s:
            break
        if _has_open(process, target):
            holders.append(_PortHolder(int(process.name), _program_name(process)))
    return holders


def _has_open(process: Path, target: str) -> bool:
    try:
        return any(
            _target(entry) == target and not _is_in_a_container(entry, target)
            for entry in os.scandir(process / "fd")
        )
    except OSError:  # another user's, or it has just ended
        return False


def _target(entry: os.DirEntry[str]) -> str:
    try:
        return os.readlink(entry.path)  # noqa: PTH115 - a Path per open file takes too long
    except OSError:  # closed since it was listed
        return ""


def _is_in_a_container(entry: os.DirEntry[str], target: str) -> bool:
    """Whether an open pseudo-terminal is one of a container, whose /dev/pts has the same names."""
    if not target.startswith("/dev/pts/"):
        return False
    try:
        return entry.stat().st_dev != os.stat(target).st_dev  # noqa: PTH116 - as above
    except OSError:  # closed since it was listed
        return True


def _program_name(process: Path) -> str:
    try:
        return (process / "comm").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return "a program"


_READ_SLICE_S = 0.05  # longest blocking read, and so the error of a time-out
_PROBE_WAIT_S = 0.2  # for programs that open a port briefly, such as a device manager
_CONNECT_S = 5.0  # two lost packets cost 3 s (RFC 6298); a local connection takes less than 1 ms
_TCP_SCHEME = "socket"
_TCP_READ_BYTES = 4096
_IN_USE = "in use by {}; close that first"


class _BytePort(Protocol):
    """An open port. All methods raise `OSError` once the port is gone."""

    def receive(self) -> bytes:
        """Return the bytes that have arrived; wait for the first for at most 50 ms."""

    def write(self, data: bytes) -> object:
        """Send all of `data`, within the time-out of the port."""

    def close(self) -> None:
        """Release the port; never raise."""


def open_port(port: str, baud: int, write_timeout_s: float) -> _BytePort:
    """Open a serial device, ``socket://HOST:PORT``, or another URL that pyserial knows."""
    try:
        address = urlsplit(port)
        if address.scheme == _TCP_SCHEME and address.hostname and address.port:
            return _TcpPort((address.hostname, address.port), write_timeout_s)
        return _SerialPort(port, baud, write_timeout_s)
    except (OSError, ValueError) as error:
        raise LightControllerError(f"{port}: {_why_not_open(error)}") from error


def pyserial() -> ModuleType:
    """Import pyserial, which needs a system with serial ports."""
    try:
        import serial
    except ImportError as error:
        raise ConfigError(
            f"serial ports cannot be used on this system ({error}); set lights.port to "
            "'simulated', or to socket://HOST:PORT of a controller on the network"
        ) from error
    module: ModuleType = serial
    return module


class _SerialPort:
    """A port that pyserial opens, for this program alone."""

    def __init__(self, port: str, baud: int, write_timeout_s: float) -> None:
        if "://" not in port:
            _refuse_a_shared_port(port)
        self._serial: Any = pyserial().serial_for_url(
            port,
            baudrate=baud,
            timeout=_READ_SLICE_S,
            write_timeout=write_timeout_s,
            exclusive=True,
        )
        self.write = self._serial.write
        # pyserial's lock only excludes programs that ask for a lock too.
        self._terminal_control("TIOCEXCL")

    def receive(self) -> bytes:
        data: bytes = self._serial.read(1)
        waiting = self._serial.in_waiting
        return data + self._serial.read(waiting) if waiting else data

    def close(self) -> None:
        # Otherwise a pseudo-terminal would stay exclusive while its master is open.
        self._terminal_control("TIOCNXCL")
        with suppress(OSError):
            self._serial.close()

    def _terminal_control(self, request: str) -> None:
        try:
            import fcntl
            import termios
        except ImportError:  # not a POSIX system, where a port can be opened only once
            return
        with suppress(OSError, AttributeError, NotImplementedError):
            fcntl.ioctl(self._serial.fileno(), getattr(termios, request))


def _refuse_a_shared_port(port: str) -> None:
    """Refuse a port that another program has open, even if it has not locked it."""
    for pause_s in (_PROBE_WAIT_S, 0.0):
        holders = [holder for holder in port_holders(port) if holder.pid != os.getpid()]
        if not holders:
            return
        time.sleep(pause_s)
    raise LightControllerError(f"{port}: {_IN_USE.format(holders[0])}")


class _TcpPort:
    """A TCP connection; pyserial's own reads one byte at a time, and takes 0.3 s to close."""

    def __init__(self, address: tuple[str, int], write_timeout_s: float) -> None:
        self._socket = socket.create_connection(address, _CONNECT_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._write_timeout_s = write_timeout_s

    def receive(self) -> bytes:
        self._socket.settimeout(_READ_SLICE_S)
        try:
            data = self._socket.recv(_TCP_READ_BYTES)
        except TimeoutError:
            return b""
        if not data:
            raise ConnectionResetError("the connection was closed")
        return data

    def write(self, data: bytes) -> None:
        self._socket.settimeout(self._write_timeout_s)
        self._socket.sendall(data)

    def close(self) -> None:
        with suppress(OSError):
            self._socket.close()


def _why_not_open(error: OSError | ValueError) -> str:
    code = getattr(error, "errno", None)
    if code == errno.ENOENT:
        return "no such port; is the light controller plugged in?"
    if code == errno.EACCES:
        return "no permission; add yourself to the group that owns it (dialout on Debian)"
    if code in (errno.EBUSY, errno.EAGAIN):
        return _IN_USE.format("another program")
    if code == errno.ECONNREFUSED:
        return "cannot be opened: no program listens there; is the controller's server running?"
    return f"cannot be opened as a serial port ({error})"


_MAX_LINE_BYTES = 512  # the longest reply, LED:STAT? of 64 LEDs, has about 280 bytes


class ReplyTimeout:
    """The time left for a reply; time in which this program was not scheduled does not count."""

    def __init__(self, left_s: float) -> None:
        self.left_s = left_s
        self._counted_s = time.monotonic()

    def count(self) -> None:
        """Subtract the time since the last call, at most the longest read, `_READ_SLICE_S`."""
        now_s = time.monotonic()
        self.left_s -= min(now_s - self._counted_s, _READ_SLICE_S)
        self._counted_s = now_s


class SerialLine:
    """An exclusively opened port, or any URL that pyserial knows (``socket://...``)."""

    def __init__(self, port: str, baud: int, write_timeout_s: float) -> None:
        self.port = port
        self._buffer = bytearray()
        self._byte_port = open_port(port, baud, write_timeout_s)

    def write(self, data: bytes) -> None:
        """Send `data`; raise `LightControllerError` if the port is gone or accepts nothing."""
        try:
            self._byte_port.write(data)
        except OSError as error:
            raise self._disconnection(error) from error

    def read_line(self, timeout: ReplyTimeout) -> bytes | None:
        """Return the next line without its end, or None at the end of `timeout`."""
        while True:
            end = self._buffer.find(b"\n")
            if end >= 0:
                line = bytes(self._buffer[:end]).rstrip(b"\r")
                del self._buffer[: end + 1]
                return line
            if len(self._buffer) > _MAX_LINE_BYTES:
                self._buffer.clear()
                raise LightControllerError(
                    f"{self.port}: {_MAX_LINE_BYTES} bytes without a line end; this is not a "
                    "light controller, or the baud rate is wrong"
                )
            if timeout.left_s <= 0.0:
                return None
            try:
                self._buffer += self._byte_port.receive()
            except OSError as error:
                raise self._disconnection(error) from error
            timeout.count()

    def close(self) -> None:
        """Release the port; never raise."""
        self._byte_port.close()

    def _disconnection(self, error: OSError) -> LightControllerError:
        return LightControllerError(
            f"{self.port}: the light controller is gone ({error}); check cable and power"
        )
