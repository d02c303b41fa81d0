"""Whole lines over a serial port, each with a deadline.

Bytes are collected until a line is complete; pyserial's own `readline` may return half a line.
"""

import errno
import os
import time
from contextlib import suppress
from typing import Any

import serial

from rig.errors import LightControllerError

from .port_holders import port_holders

_READ_SLICE_S = 0.05  # longest blocking read, and so the error of a deadline
_MAX_LINE_BYTES = 512  # replies have at most 100 bytes
_IN_USE = "in use by {}; close that first"


class SerialLine:
    """An exclusively opened port, or any URL that pyserial knows (``socket://...``)."""

    def __init__(self, port: str, baud: int, write_timeout_s: float) -> None:
        self.port = port
        self._buffer = bytearray()
        try:
            # A program that has not locked the port would otherwise share it.
            for holder in [] if "://" in port else port_holders(port):
                if holder.pid != os.getpid():
                    raise LightControllerError(f"{port}: {_IN_USE.format(holder)}")
            self._serial: Any = serial.serial_for_url(
                port,
                baudrate=baud,
                timeout=_READ_SLICE_S,
                write_timeout=write_timeout_s,
                exclusive=True,
            )
        except (OSError, ValueError) as error:
            raise LightControllerError(f"{port}: {_why_not_open(error)}") from error
        # pyserial's lock only excludes programs that ask for a lock too.
        self._terminal_control("TIOCEXCL")

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
