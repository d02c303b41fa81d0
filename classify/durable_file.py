"""Writing a file so that a reader, or a power cut, never meets half of it."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import InputError

__all__ = ["durable_file", "make_folder", "require_folder"]


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, where they are not there yet.

    Raises
    ------
    InputError
        If that cannot be done.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from error


def require_folder(path: Path) -> None:
    """Make sure, before the work, that the folder for its result is there.

    Raises
    ------
    InputError
        If not.
    """
    if not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written: there is no folder {path.parent}")


@contextmanager
def durable_file(path: Path) -> Iterator[Path]:
    """A temporary path in the same folder that becomes `path` when the block ends well.

    The data are forced to disk before the rename, and the rename after it. If the block raises,
    or the disk is full, the temporary file goes and an older `path` stays as it was.

    Raises
    ------
    InputError
        If the file cannot be written: no such folder, no permission, disk full.
    """
    # The ending is kept, because some writers choose their format by it.
    temporary = path.parent / f".writing-{secrets.token_hex(8)}{path.suffix}"
    try:
        # Made by open and not by tempfile, whose files no one else may read: the mask of the
        # process would have to be asked for to mend that, and asking changes it for all threads.
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error
    try:
        yield temporary
        _sync(temporary)
        temporary.replace(path)
        _sync(path.parent)
    except OSError as error:
        cause = error.strerror or f"{error}; is the disk full?"
        raise InputError(f"{path}: cannot be written: {cause}") from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
