"""Addresses of the simulated device: sockets here, terminals in `terminals`.

An endpoint gives the server one open line per host that connects.
"""

import os
import socket
from pathlib import Path
from typing import Protocol


class HostLine(Protocol):
    """The open line to a host that has connected. It does not block."""

    def fileno(self) -> int:
        """Return the descriptor, for waiting on it."""

    def read(self, limit: int) -> bytes:
        """Return up to `limit` bytes that have arrived, nothing if the host has hung up."""

    def write(self, data: bytes) -> int:
        """Send as many bytes as the line accepts; return their number."""


class Endpoint:
    """A place to connect to, for one host at a time."""

    address: str  # what a host opens
    listener_fd: int | None = None  # readable when a host connects; None: poll `accept`

    def accept(self) -> HostLine | None:
        """Return the line to a host that has connected, or None."""
        raise NotImplementedError

    def refuse(self) -> None:
        """Reject a host that connects while another is connected."""

    def hang_up(self) -> None:
        """Prepare for the next host after the last one has gone."""

    def close(self) -> None:
        """Close all descriptors and remove the files that were made."""


class _SocketEndpoint(Endpoint):
    """A bound and listening socket; its file `path` is removed at the end."""

    def __init__(self, listener: socket.socket, address: str, path: Path | None = None) -> None:
        listener.setblocking(False)
        self.address = address
        self.listener_fd = listener.fileno()
        self._listener = listener
        self._path = path
        self._host: socket.socket | None = None

    def accept(self) -> HostLine | None:
        self._host = self._next_host()
        return None if self._host is None else _SocketLine(self._host)

    def refuse(self) -> None:
        host = self._next_host()
        if host is not None:
            host.close()

    def hang_up(self) -> None:
        if self._host is not None:
            self._host.close()
            self._host = None

    def close(self) -> None:
        self.hang_up()
        self._listener.close()
        if self._path is not None:
            self._path.unlink(missing_ok=True)

    def _next_host(self) -> socket.socket | None:
        try:
            host, _ = self._listener.accept()
        except OSError:
            return None  # no host, or it has gone before it was accepted
        host.setblocking(False)
        if host.family == socket.AF_INET:
            host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return host


class _SocketLine:
    """A socket as a `HostLine`; not every system reads a socket by its descriptor."""

    def __init__(self, host: socket.socket) -> None:
        self.fileno = host.fileno
        self.read = host.recv
        self.write = host.send


def unix_endpoint(path: Path) -> _SocketEndpoint:
    """Listen on a unix socket, at a path that does not exist yet."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    _listen(listener, str(path))
    return _SocketEndpoint(listener, str(path), path)


def tcp_endpoint(port: int) -> _SocketEndpoint:
    """Listen on a TCP port of 127.0.0.1; 0 chooses a free one."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if os.name == "posix":  # elsewhere it would let two programs have one port
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    _listen(listener, ("127.0.0.1", port))
    host, port = listener.getsockname()
    return _SocketEndpoint(listener, f"socket://{host}:{port}")


def _listen(listener: socket.socket, where: str | tuple[str, int]) -> None:
    try:
        listener.bind(where)
        listener.listen()
    except (OSError, OverflowError):
        listener.close()
        raise
