"""Write files so that no reader, even after a power cut, sees a partial one."""

import errno
import os
import secrets
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import InputError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_PREFIX = ".writing-"
# Without locks, a temporary file that was not written to for this time is that of a killed writer.
# The longest work on one output, the figures of ps4rig reproduce, takes half an hour.
_ABANDONED_S = 86_400.0
# Errors of systems that cannot force the entries of a folder to disk: Windows opens no folder, and
# some network file systems refuse the call.
_NO_FOLDER_SYNC = {
    errno.EACCES, errno.EPERM, errno.EISDIR, errno.EBADF, errno.EINVAL, errno.ENOSYS, errno.ENOTSUP,
}  # fmt: skip


def make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from error


def require_folder(path: Path) -> None:
    """Check that the folder of an output exists, before the work on it begins."""
    if not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written: there is no folder {path.parent}")


@contextmanager
def durable_file(path: Path, home: Path | None = None) -> Iterator[Path]:
    """Yield a temporary path that becomes `path` when the block ends without an error.

    Data and rename are forced to disk, and links are followed; `home` is another folder of the same
    file system for the temporary file.
    """
    try:
        target = path.resolve() if path.is_symlink() else path
        special = target.exists() and not (target.is_file() or target.is_dir())
    except (OSError, RuntimeError) as error:  # RuntimeError: a loop of links, up to Python 3.12
        cause = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be written: {cause}") from error
    if special:
        raise InputError(f"{path}: cannot be written: it is not a regular file")
    # Some writers choose their format by the suffix.
    with locked_temporary(home or target.parent, path, suffix=target.suffix) as temporary:
        yield temporary
        sync(temporary)
        temporary.replace(target)
        sync(target.parent)


@contextmanager
def locked_temporary(
    home: Path, path: Path, *, suffix: str = "", is_folder: bool = False
) -> Iterator[Path]:
    """Yield a new locked file or folder in `home`, and remove it at the end.

    Those of killed writers are removed first; where `fcntl` is missing, after a day.
    """
    try:
        _remove_abandoned(home)
        temporary, lock = _new_temporary(home, suffix, is_folder)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error
    try:
        yield temporary
    except OSError as error:
        cause = error.strerror or f"{error}; is the disk full?"
        raise InputError(f"{path}: cannot be written: {cause}") from error
    finally:
        with suppress(OSError):
            _remove(temporary)
        if lock is not None:
            os.close(lock)


def _new_temporary(home: Path, suffix: str, is_folder: bool) -> tuple[Path, int | None]:
    """Make a temporary file or folder, locked as long as the descriptor is open.

    Without `fcntl` there is no descriptor: Windows renames no file that is open.
    """
    while True:
        temporary = home / f"{_PREFIX}{secrets.token_hex(8)}{suffix}"
        if is_folder:
            temporary.mkdir()
        else:
            # `tempfile` makes files that only their owner may read. Changing that takes the umask,
            # which can be read only by setting it for all threads.
            os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        if fcntl is None:
            return temporary, None
        # Another writer may remove it as abandoned until it is locked.
        try:
            lock = _opened(temporary)
        except FileNotFoundError:
            continue
        # On a file system without locks, it is not removed after a kill.
        with suppress(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX)
        if temporary.exists():
            return temporary, lock
        os.close(lock)


def _remove_abandoned(home: Path) -> None:
    """Remove the temporary files and folders of killed writers."""
    for path in home.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            if fcntl is None:
                if time.time() - path.lstat().st_mtime > _ABANDONED_S:
                    _remove(path)
                continue
            lock = _opened(path)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                _remove(path)
            finally:
                os.close(lock)


def _opened(temporary: Path) -> int:
    kind = os.O_DIRECTORY if temporary.is_dir() else os.O_WRONLY
    return os.open(temporary, kind | os.O_NOFOLLOW | os.O_NONBLOCK)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def sync(path: Path) -> None:
    """Force a file to disk, or the entries of a folder where the system can do that."""
    if path.is_dir():
        try:
            _sync(path, os.O_RDONLY)
        except OSError as error:
            if error.errno not in _NO_FOLDER_SYNC:
                raise
    else:
        # Windows syncs only what is open for writing.
        _sync(path, os.O_RDWR if os.access(path, os.W_OK) else os.O_RDONLY)


def _sync(path: Path, flags: int) -> None:
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
