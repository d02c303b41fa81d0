"""Standard output and standard error that accept all writes."""

import io
import os
import sys
from pathlib import Path
from typing import Any, TextIO

BROKEN_PIPE_STATUS = 141  # 128 + SIGPIPE, as shells report it
_WRITE_ERROR_STATUS = 2


class _TolerantFile(io.FileIO):
    """A file descriptor that discards everything after the first error of a write."""

    error: OSError | None = None

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            self.error = error
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self.fileno())
            os.close(null)
            return memoryview(data).nbytes


class StandardStreams:
    """Replace the standard streams for the rest of the process.

    After a failed write, such as to a closed pipe, or if the parent process has closed the stream,
    output is discarded; a closed input is empty.
    """

    def __init__(self) -> None:
        # Otherwise the next opened file would get the descriptor of a closed stream.
        while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
            pass
        os.close(descriptor)
        if sys.stdin is None:
            sys.stdin = Path(os.devnull).open(encoding="utf-8")  # noqa: SIM115 - to the end
        self._output, sys.stdout = _tolerant(1, sys.stdout)
        _, sys.stderr = _tolerant(2, sys.stderr)

    def final_status(self, status: int) -> int:
        """Flush both streams; a failed write changes the status 0 of a command."""
        sys.stdout.flush()
        error = self._output.error
        if error is not None and not isinstance(error, BrokenPipeError):
            print(f"ps4rig: standard output: {error.strerror}", file=sys.stderr)
            status = status or _WRITE_ERROR_STATUS
        sys.stderr.flush()
        return status or (BROKEN_PIPE_STATUS if error is not None else 0)


def _tolerant(descriptor: int, old: TextIO | None) -> tuple[_TolerantFile, TextIO]:
    raw = _TolerantFile(descriptor, "w", closefd=False)
    new = io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=old.encoding if old else "utf-8",
        errors="backslashreplace",
        line_buffering=descriptor == 2 or raw.isatty(),
        write_through=bool(os.environ.get("PYTHONUNBUFFERED")),
    )
    return raw, new
