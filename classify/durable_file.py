"""Writing a file so that a reader, or a power cut, never meets half of it."""

from __future__ import annotations

import fcntl
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import InputError

__all__ = ["durable_file", "make_folder", "require_folder", "sync"]

_PREFIX = ".writing-"


def make_folder(folder: Path) -> None:
    """Make a folder and its parents where they are missing.

    Raises
    ------
    InputError
        If the folder cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from error


def require_folder(path: Path) -> None:
    """Check, before the work, that the folder of its result exists.

    Raises
    ------
    InputError
        If the folder is missing.
    """
    if not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written: there is no folder {path.parent}")


@contextmanager
def durable_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the same folder that becomes `path` when the block ends well.

    The data are forced to disk before the rename, and the rename after it. If the block raises,
    or the disk is full, the temporary file is removed and an older `path` stays as it was. If
    `path` is a symbolic link, the file that it points to is replaced, and the link stays.

    Temporary files in this folder whose writers were killed are removed.

    Raises
    ------
    InputError
        If the file cannot be written: no such folder, no permission, disk full, or a device or
        pipe in its place.
    """
    try:
        target = path.resolve() if path.is_symlink() else path
        if target.exists() and not (target.is_file() or target.is_dir()):
            raise InputError(f"{path}: cannot be written: it is not a regular file")
        _remove_abandoned(target.parent)
        temporary, lock = _locked_file(target)
    except (OSError, RuntimeError) as error:  # RuntimeError: a loop of links, up to Python 3.12
        cause = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be written: {cause}") from error
    try:
        yield temporary
        sync(temporary)
        temporary.replace(target)
        sync(target.parent)
    except OSError as error:
        cause = error.strerror or f"{error}; is the disk full?"
        raise InputError(f"{path}: cannot be written: {cause}") from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        os.close(lock)


def _locked_file(target: Path) -> tuple[Path, int]:
    """Make a temporary file beside `target`, and lock it for as long as the descriptor is open."""
    while True:
        # Some writers choose their format by the suffix.
        temporary = target.parent / f"{_PREFIX}{secrets.token_hex(8)}{target.suffix}"
        # Not by `tempfile`, whose files only their owner may read. To mend that takes the umask,
        # which can be read only by changing it, for all threads.
        lock = os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666)
        # File systems without locks: the file is not removed after a kill either.
        with suppress(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX)
        # Another writer may have taken the file for abandoned before it was locked.
        if os.fstat(lock).st_nlink > 0:
            return temporary, lock
        os.close(lock)


def _remove_abandoned(folder: Path) -> None:
    """Remove temporary files that no writer holds a lock on."""
    for path in folder.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            if not stat.S_ISREG(path.lstat().st_mode):
                continue
            lock = os.open(path, os.O_WRONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                path.unlink()
            finally:
                os.close(lock)


def sync(path: Path) -> None:
    """Force a file, or the entries of a folder, to disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
