"""Terminals at which a host finds the simulated device.

On a system without terminals the import of this module fails.
"""

import fcntl
import os
import termios
import tty
from os import O_NOCTTY, O_NONBLOCK, O_RDWR, openpty, set_blocking, ttyname
from pathlib import Path
from select import POLLHUP, POLLIN, poll

from .endpoints import Endpoint, HostLine


class _TerminalLine:
    """A descriptor as a `HostLine`."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def fileno(self) -> int:
        return self._descriptor

    def read(self, limit: int) -> bytes:
        return os.read(self._descriptor, limit)

    def write(self, data: bytes) -> int:
        return os.write(self._descriptor, data)


class PtyEndpoint(Endpoint):
    """A raw pseudo-terminal, optionally with a symbolic link at a new path."""

    def __init__(self, link: Path | None = None) -> None:
        self._master, slave = openpty()
        self.address = ttyname(slave)
        self._link = link
        self._was_open = False
        # Without an open slave the master reports POLLHUP until a host opens one.
        os.close(slave)
        set_blocking(self._master, False)
        self._make_ready()
        if link is not None:
            try:
                link.symlink_to(self.address)
            except OSError:
                os.close(self._master)
                raise

    def accept(self) -> HostLine | None:
        if self._hung_up():
            self._was_open = False
            return None
        if not self._was_open:
            # Let the host finish opening: pyserial then discards the bytes that have arrived.
            self._was_open = True
            return None
        return _TerminalLine(self._master)

    def hang_up(self) -> None:
        self._was_open = False
        self._make_ready()

    def close(self) -> None:
        os.close(self._master)
        link = self._link
        if link is not None and link.is_symlink() and str(link.readlink()) == self.address:
            link.unlink()

    def _hung_up(self) -> bool:
        polled = poll()
        polled.register(self._master, POLLIN)
        events = dict(polled.poll(0)).get(self._master, 0)
        # Input that a host sent before it closed is still served.
        return bool(events & POLLHUP) and not events & POLLIN

    def _make_ready(self) -> None:
        # Settings and unread replies remain after a host closes; the next must not find them.
        try:
            slave = os.open(self.address, O_RDWR | O_NOCTTY | O_NONBLOCK)
        except OSError:
            return  # the next host already has it open exclusively
        try:
            tty.setraw(slave, termios.TCSANOW)
            termios.tcflush(slave, termios.TCIFLUSH)
        finally:
            os.close(slave)


class TtyEndpoint(Endpoint):
    """A serial device: this end of a null modem or a USB gadget, which may be unplugged."""

    def __init__(self, path: Path, baud: int) -> None:
        self.address = str(path)
        try:
            self._speed: int = getattr(termios, f"B{baud}")
        except AttributeError:
            raise ValueError(f"{baud} baud is not a speed of a serial device") from None
        self._fd = self._open()

    def accept(self) -> HostLine | None:
        if self._fd is None:
            try:
                self._fd = self._open()
            except OSError:
                return None  # unplugged
        return None if self._fd is None else _TerminalLine(self._fd)

    def hang_up(self) -> None:
        self.close()

    def close(self) -> None:
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None

    def _open(self) -> int | None:
        fd = os.open(self.address, O_RDWR | O_NOCTTY | O_NONBLOCK)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            fcntl.ioctl(fd, termios.TIOCEXCL)
            # Before all else, because a terminal that is not raw echoes bytes to the host.
            tty.setraw(fd, termios.TCSANOW)
            settings = termios.tcgetattr(fd)
            # The control flags: ignore the other end's modem lines, and use no flow control.
            settings[2] = settings[2] & ~termios.CRTSCTS | termios.CLOCAL | termios.CREAD
            settings[4] = settings[5] = self._speed  # of input and of output
            termios.tcsetattr(fd, termios.TCSANOW, settings)
            termios.tcflush(fd, termios.TCIOFLUSH)
        except termios.error as error:
            os.close(fd)
            raise OSError(*error.args) from error
        except OSError:
            os.close(fd)
            raise
        return fd
