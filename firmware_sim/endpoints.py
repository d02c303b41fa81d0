"""Places at which a host finds the simulated device: pseudo-terminal, serial device, socket.

An endpoint gives the server one file descriptor per host that connects.
"""

import fcntl
import os
import select
import socket
import termios
import tty
from pathlib import Path


class Endpoint:
    """A place to connect to, for one host at a time.

    Attributes
    ----------
    address
        The address that a host opens.
    listener_fd
        Descriptor that becomes readable when a host connects; None: poll `accept`.
    """

    address: str
    listener_fd: int | None = None

    def accept(self) -> int | None:
        """Return the non-blocking descriptor of a host that has connected, or None."""
        raise NotImplementedError

    def refuse(self) -> None:
        """Reject a host that connects while another is connected."""

    def hang_up(self) -> None:
        """Prepare for the next host after the last one has gone."""

    def close(self) -> None:
        """Close all descriptors and remove the files that were made."""


class PtyEndpoint(Endpoint):
    """A raw pseudo-terminal, optionally with a symbolic link at a path that does not exist yet.

    A pty does not announce that it has been opened, so `accept` must be polled.
    """

    def __init__(self, link: Path | None = None) -> None:
        self._master, slave = os.openpty()
        self.address = os.ttyname(slave)
        self._link = link
        self._was_open = False
        # Without an open slave the master reports POLLHUP until a host opens one.
        os.close(slave)
        os.set_blocking(self._master, False)
        self._make_ready()
        if link is not None:
            try:
                link.symlink_to(self.address)
            except OSError:
                os.close(self._master)
                raise

    def accept(self) -> int | None:
        if self._hung_up():
            self._was_open = False
            return None
        if not self._was_open:
            # Let the host finish opening: pyserial then discards the bytes that have arrived.
            self._was_open = True
            return None
        return self._master

    def hang_up(self) -> None:
        self._was_open = False
        self._make_ready()

    def close(self) -> None:
        os.close(self._master)
        link = self._link
        if link is not None and link.is_symlink() and str(link.readlink()) == self.address:
            link.unlink()

    def _hung_up(self) -> bool:
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        events = dict(poll.poll(0)).get(self._master, 0)
        # Input that a host sent before it closed is still served.
        return bool(events & select.POLLHUP) and not events & select.POLLIN

    def _make_ready(self) -> None:
        # Settings and unread replies remain after a host closes; the next must not find them.
        try:
            slave = os.open(self.address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError:
            return  # the next host already has it open exclusively
        try:
            tty.setraw(slave, termios.TCSANOW)
            termios.tcflush(slave, termios.TCIFLUSH)
        finally:
            os.close(slave)


class TtyEndpoint(Endpoint):
    """A real serial device: this end of a null modem, or of a USB gadget's line.

    Such a line does not show whether its other end is open, so a host counts as connected while
    the device exists. A device that disappears is opened again when it is back.

    Raises
    ------
    OSError
        If the device is missing, not permitted, in use or not a serial device.
    ValueError
        If serial devices do not have the speed `baud`.
    """

    def __init__(self, path: Path, baud: int) -> None:
        self.address = str(path)
        try:
            self._speed: int = getattr(termios, f"B{baud}")
        except AttributeError:
            raise ValueError(f"{baud} baud is not a speed of a serial device") from None
        self._fd = self._opened()

    def accept(self) -> int | None:
        if self._fd is None:
            try:
                self._fd = self._opened()
            except OSError:
                return None  # unplugged
        return self._fd

    def hang_up(self) -> None:
        self.close()

    def close(self) -> None:
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None

    def _opened(self) -> int | None:
        fd = os.open(self.address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            fcntl.ioctl(fd, termios.TIOCEXCL)
            # First, because a terminal that is not raw echoes bytes to the host.
            tty.setraw(fd, termios.TCSANOW)
            settings = termios.tcgetattr(fd)
            # Ignore the other end's modem lines, and use no flow control.
            settings[2] = settings[2] & ~termios.CRTSCTS | termios.CLOCAL | termios.CREAD
            settings[4] = settings[5] = self._speed
            termios.tcsetattr(fd, termios.TCSANOW, settings)
            termios.tcflush(fd, termios.TCIOFLUSH)
        except termios.error as error:
            os.close(fd)
            raise OSError(*error.args) from error
        except OSError:
            os.close(fd)
            raise
        return fd


class SocketEndpoint(Endpoint):
    """A bound and listening socket; its file `path` is removed at the end."""

    def __init__(self, listener: socket.socket, address: str, path: Path | None = None) -> None:
        listener.setblocking(False)
        self.address = address
        self.listener_fd = listener.fileno()
        self._listener = listener
        self._path = path
        self._host: socket.socket | None = None

    def accept(self) -> int | None:
        self._host = self._next_host()
        return None if self._host is None else self._host.fileno()

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


def unix_endpoint(path: Path) -> SocketEndpoint:
    """Listen on a unix socket, at a path that does not exist yet."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    _listen(listener, str(path))
    return SocketEndpoint(listener, str(path), path)


def tcp_endpoint(port: int) -> SocketEndpoint:
    """Listen on a TCP port of 127.0.0.1; 0 chooses a free one."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    _listen(listener, ("127.0.0.1", port))
    host, port = listener.getsockname()
    return SocketEndpoint(listener, f"socket://{host}:{port}")


def _listen(listener: socket.socket, where: str | tuple[str, int]) -> None:
    try:
        listener.bind(where)
        listener.listen()
    except (OSError, OverflowError):
        listener.close()
        raise
