"""The end of a process: standard streams that accept all writes, logs of unforeseen errors."""

import io
import os
import platform
import sys
import tempfile
import threading
import traceback
from contextlib import suppress
from datetime import UTC, datetime
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
    """Standard streams that discard what cannot be written, and whose closed input is empty."""

    def __init__(self) -> None:
        # Otherwise the next opened file would get the descriptor of a stream that is closed.
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


def _tolerant(descriptor: int, stream: TextIO | None) -> tuple[_TolerantFile, TextIO]:
    """Make a stream that tolerates errors, in the encoding of `stream`."""
    raw = _TolerantFile(descriptor, "w", closefd=False)
    tolerant_stream = io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=stream.encoding if stream else "utf-8",
        errors="backslashreplace",
        line_buffering=descriptor == 2 or raw.isatty(),
        write_through=bool(os.environ.get("PYTHONUNBUFFERED")),
    )
    return raw, tolerant_stream


CRASH_STATUS = 70  # EX_SOFTWARE of sysexits.h
# Number of log files, and length of each: at most 1.3 MB on the disk.
_MAX_LOGS = 20
_MAX_CHARACTERS = 2**16


def report_crash(error: BaseException) -> int:
    """Write the traceback to a log file and one line to stderr; return the exit status."""
    path = _write_log("".join(traceback.format_exception(error)))
    where = f"the traceback is in {path}" if path else "no log file could be written"
    cause = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    print(f"ps4rig: unforeseen error ({cause}); {where}", file=sys.stderr)
    return CRASH_STATUS


def log_threads() -> None:
    """Write log files for the unforeseen errors of all other threads."""

    def report(args: threading.ExceptHookArgs) -> None:
        if args.exc_value is not None and not isinstance(args.exc_value, SystemExit):
            report_crash(args.exc_value)

    threading.excepthook = report


def _write_log(trace: str) -> Path | None:
    """Write a log to the user's state folder, or else to the folder for temporary files."""
    from importlib.metadata import version

    text = (
        f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC, ps4rig {version('ps4rig')}, "
        f"Python {platform.python_version()}, {platform.platform()}\n"
        f"{sys.argv}\n\n{trace[-_MAX_CHARACTERS:]}"
    )
    for find_folder in (_state_folder, tempfile.gettempdir):
        with suppress(OSError, RuntimeError):  # RuntimeError: the user has no home folder
            folder = Path(find_folder())
            folder.mkdir(parents=True, exist_ok=True)
            stamp = f"{datetime.now(UTC):%Y%m%dT%H%M%S}"
            descriptor, name = tempfile.mkstemp(".log", f"ps4rig-crash-{stamp}-", folder)
            os.close(descriptor)
            path = Path(name)
            path.write_text(text, encoding="utf-8", errors="backslashreplace")
            _remove_old_logs(folder)
            return path
    return None


def _state_folder() -> Path:
    # https://specifications.freedesktop.org/basedir-spec: a relative path is ignored.
    state_home = Path(os.environ.get("XDG_STATE_HOME", ""))
    if state_home.is_absolute():
        return state_home / "ps4rig"
    return Path("~/.local/state/ps4rig").expanduser()


def _remove_old_logs(folder: Path) -> None:
    for path in sorted(folder.glob("ps4rig-crash-*.log"))[:-_MAX_LOGS]:
        with suppress(OSError):
            path.unlink()
