"""Locks on a folder or a file, for one program at a time, that end with the program."""

import errno
import os
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from classify.base.errors import InputError

from .utc_time import utc_text

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

# Ending of the empty file that SQLite locks. It is never removed: two programs could then lock two
# files of one name.
LOCK_FILE_SUFFIX = ".held"
_OWNER_BYTES = 100
# Errors of a lock on network and FUSE file systems.
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP)


@contextmanager
def folder_lock(folder: Path, owner_file: str) -> Iterator[None]:
    """Hold a lock on a folder during the block; a second program is refused."""
    # The refusal quotes `owner_file`, which names the holder. The operating system releases the
    # lock at the end of the program.
    owner_path = folder / owner_file
    try:
        release = _lock_folder(folder) if fcntl is not None else _lock_file(owner_path, 0.0)
    except BlockingIOError as error:
        owner = ""
        with suppress(OSError):
            owner = owner_path.read_bytes()[:_OWNER_BYTES].decode(errors="replace").strip()
        raise InputError(
            f"{folder}: in use by {owner or 'another program'}; end it first"
        ) from error
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be locked: {error.strerror or error}{_remedy(error)}"
        ) from error
    try:
        _write_owner(owner_path)
        yield
        owner_path.unlink(missing_ok=True)
    finally:
        release()


@contextmanager
def file_lock(path: Path, timeout_s: float) -> Iterator[None]:
    """Hold a lock on a file during the block; a second program waits for at most `timeout_s`."""
    # A file that is replaced cannot be locked itself.
    try:
        release = _lock_file(path, timeout_s)
    except BlockingIOError as error:
        raise InputError(f"{path}: another program changes it; try again") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be locked: {error}{_remedy(error)}") from error
    try:
        yield
    finally:
        release()


def _remedy(error: OSError) -> str:
    if error.errno not in _NO_LOCKS:
        return ""
    return (
        "; this file system has no locks: use a folder on a local disk, or mount the share with "
        "locks (NFS: without nolock, SMB: without nobrl)"
    )


def _write_owner(path: Path) -> None:
    try:
        path.write_text(f"ps4rig, process {os.getpid()} since {utc_text()}", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def _lock_folder(folder: Path) -> Callable[[], None]:
    descriptor = os.open(folder, os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return lambda: os.close(descriptor)


def _lock_file(locked: Path, timeout_s: float) -> Callable[[], None]:
    path = locked.with_name(locked.name + LOCK_FILE_SUFFIX)
    connection: sqlite3.Connection | None = None
    try:
        connection = sqlite3.connect(
            path, timeout=timeout_s, isolation_level=None, check_same_thread=False
        )
        connection.execute("BEGIN EXCLUSIVE")
    except sqlite3.Error as error:
        if connection is not None:
            connection.close()
        is_held = error.sqlite_errorcode == sqlite3.SQLITE_BUSY
        raise (BlockingIOError if is_held else OSError)(f"{path.name}: {error}") from error
    return connection.close
