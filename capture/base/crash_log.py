"""Log files of unforeseen errors."""

import os
import platform
import sys
import tempfile
import threading
import traceback
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

CRASH_STATUS = 70  # EX_SOFTWARE of sysexits.h
# Enough for several reports of a fault, and at most 1.3 MB on the disk.
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
    stated = Path(os.environ.get("XDG_STATE_HOME", ""))
    if stated.is_absolute():
        return stated / "ps4rig"
    return Path("~/.local/state/ps4rig").expanduser()


def _remove_old_logs(folder: Path) -> None:
    for path in sorted(folder.glob("ps4rig-crash-*.log"))[:-_MAX_LOGS]:
        with suppress(OSError):
            path.unlink()
