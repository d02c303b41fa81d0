"""Whole lines over a serial port, each with a deadline.

pyserial's own `readline` returns half a line at a time-out, and the rest in the next call. Here
bytes are collected until a line is complete.
"""

from __future__ import annotations

import errno
import os
import time
from contextlib import suppress
from typing import Any

import serial

from rig.errors import LightControllerError

from .port_holders import port_holders

__all__ = ["SerialLine"]

_READ_SLICE_S = 0.05  # longest blocking read, and so the error of a deadline
_MAX_LINE_BYTES = 512  # replies have at most 100 bytes; with more this is not a controller
_IN_USE = "in use by {}; close that first"


class SerialLine:
    """An exclusively opened port, or any URL that pyserial knows (``socket://...``)."""

    def __init__(self, port: str, baud: int, write_timeout_s: float) -> None:
        self.port = port
        self._buffer = bytearray()
        try:
            _refuse_if_held(port)
            self._serial: Any = serial.serial_for_url(
                port,
                baudrate=baud,
                timeout=_READ_SLICE_S,
                write_timeout=write_timeout_s,
                exclusive=True,
            )
        except (OSError, ValueError) as error:
            raise LightControllerError(f"{port}: {_why_not_open(error)}") from error
        _refuse_other_openers(self._serial)

    def write(self, data: bytes) -> None:
        """Send `data`; raise `LightControllerError` if the port is gone or accepts nothing."""
        try:
            self._serial.write(data)
        except OSError as error:
            raise self._lost(error) from error

    def read_line(self, deadline_s: float) -> bytes | None:
        """Return the next line without its end, or None at `deadline_s` of `time.monotonic`.

        Raises
        ------
        LightControllerError
            If the port is gone, or sends too many bytes without a line end.
        """
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
            if time.monotonic() >= deadline_s:
                return None
            try:
                self._buffer += self._serial.read(1)
                waiting = self._serial.in_waiting
                if waiting:
                    self._buffer += self._serial.read(waiting)
            except OSError as error:
                raise self._lost(error) from error

    def close(self) -> None:
        """Release the port; never raise."""
        _admit_other_openers(self._serial)
        with suppress(OSError):
            self._serial.close()

    def _lost(self, error: OSError) -> LightControllerError:
        return LightControllerError(
            f"{self.port}: the light controller is gone ({error}); check cable and power"
        )


def _why_not_open(error: OSError | ValueError) -> str:
    code = getattr(error, "errno", None)
    if code == errno.ENOENT:
        return "no such port; is the light controller plugged in?"
    if code == errno.EACCES:
        return "no permission; add yourself to the group that owns it (dialout on Debian)"
    if code in (errno.EBUSY, errno.EAGAIN):
        return _IN_USE.format("another program")
    return f"cannot be opened as a serial port ({error})"


def _refuse_if_held(port: str) -> None:
    """Refuse a port that another program has open without having locked it."""
    holders = [] if "://" in port else port_holders(port)
    for holder in holders:
        if holder.pid != os.getpid():
            raise LightControllerError(f"{port}: {_IN_USE.format(holder)}")


def _refuse_other_openers(port: Any) -> None:
    """Set TIOCEXCL, since pyserial's lock only excludes programs that ask for a lock too."""
    _terminal_control(port, "TIOCEXCL")


def _admit_other_openers(port: Any) -> None:
    """Set TIOCNXCL, or a pseudo-terminal would stay exclusive while its master is open."""
    _terminal_control(port, "TIOCNXCL")


def _terminal_control(port: Any, request: str) -> None:
    try:
        import fcntl
        import termios
    except ImportError:  # not a POSIX system, where a port can be opened only once
        return
    with suppress(OSError, AttributeError, NotImplementedError):
        fcntl.ioctl(port.fileno(), getattr(termios, request))
