"""Log files to which lines are appended."""

import os
from pathlib import Path

from classify.base.errors import InputError


def append_line(path: Path, line: str) -> None:
    """Append a line to a log, which is made if it is missing."""
    try:
        with open(path, "a", encoding="utf-8", opener=_unblocked) as file:
            file.write(f"{line}\n")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def _unblocked(path: str, flags: int) -> int:
    # Opening a pipe without a reader would wait for one; only the opening must not wait.
    descriptor = os.open(path, flags | getattr(os, "O_NONBLOCK", 0), 0o666)
    if hasattr(os, "O_NONBLOCK"):  # not on Windows
        os.set_blocking(descriptor, True)
    return descriptor
