"""The bytes to and from a light controller: over a serial port, or over TCP."""

import errno
import os
import socket
from contextlib import suppress
from types import ModuleType
from typing import Any, Protocol
from urllib.parse import urlsplit

from classify.base.errors import ConfigError
from rig.errors import LightControllerError

from .port_holders import port_holders

READ_SLICE_S = 0.05  # longest blocking read, and so the error of a time-out
_CONNECT_S = 5.0  # two lost packets cost 3 s (RFC 6298); a local connection takes less than 1 ms
_TCP_SCHEME = "socket"
_TCP_READ_BYTES = 4096
_IN_USE = "in use by {}; close that first"


class BytePort(Protocol):
    """An open port. All methods raise `OSError` once the port is gone."""

    def receive(self) -> bytes:
        """Return the bytes that have arrived; wait for the first for at most 50 ms."""

    def write(self, data: bytes) -> object:
        """Send all of `data`, within the time-out of the port."""

    def close(self) -> None:
        """Release the port; never raise."""


def open_port(port: str, baud: int, write_timeout_s: float) -> BytePort:
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
        # A program that has not locked the port would otherwise share it.
        for holder in [] if "://" in port else port_holders(port):
            if holder.pid != os.getpid():
                raise LightControllerError(f"{port}: {_IN_USE.format(holder)}")
        self._serial: Any = pyserial().serial_for_url(
            port,
            baudrate=baud,
            timeout=READ_SLICE_S,
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


class _TcpPort:
    """A TCP connection. pyserial's takes one byte at a time, and 0.3 s to close."""

    def __init__(self, address: tuple[str, int], write_timeout_s: float) -> None:
        self._socket = socket.create_connection(address, _CONNECT_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._write_timeout_s = write_timeout_s

    def receive(self) -> bytes:
        self._socket.settimeout(READ_SLICE_S)
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
