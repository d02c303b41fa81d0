"""Whole lines over a serial port, each within its time-out.

Bytes are collected until a line is complete; pyserial's own `readline` may return half a line.
"""

import time

from rig.errors import LightControllerError

from .ports import READ_SLICE_S, open_port

_MAX_LINE_BYTES = 512  # the longest reply, LED:STAT? of 64 LEDs, has about 280 bytes


class Patience:
    """The time left for an answer; time in which a busy computer ran nothing does not count."""

    def __init__(self, left_s: float) -> None:
        self.left_s = left_s
        self._counted_s = time.monotonic()

    def count(self) -> None:
        """Subtract the time since the last call, at most the longest read, `READ_SLICE_S`."""
        now_s = time.monotonic()
        self.left_s -= min(now_s - self._counted_s, READ_SLICE_S)
        self._counted_s = now_s


class SerialLine:
    """An exclusively opened port, or any URL that pyserial knows (``socket://...``)."""

    def __init__(self, port: str, baud: int, write_timeout_s: float) -> None:
        self.port = port
        self._buffer = bytearray()
        self._open = open_port(port, baud, write_timeout_s)

    def write(self, data: bytes) -> None:
        """Send `data`; raise `LightControllerError` if the port is gone or accepts nothing."""
        try:
            self._open.write(data)
        except OSError as error:
            raise self._lost(error) from error

    def read_line(self, patience: Patience) -> bytes | None:
        """Return the next line without its end, or None at the end of `patience`."""
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
            if patience.left_s <= 0.0:
                return None
            try:
                self._buffer += self._open.receive()
            except OSError as error:
                raise self._lost(error) from error
            patience.count()

    def close(self) -> None:
        """Release the port; never raise."""
        self._open.close()

    def _lost(self, error: OSError) -> LightControllerError:
        return LightControllerError(
            f"{self.port}: the light controller is gone ({error}); check cable and power"
        )
