"""Write files and folders so that no reader, even after a power cut, sees a partial one."""

import errno
import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from classify.base.errors import InputError

TEMPORARY_PREFIX = ".writing-"
"""Prefix of a file or folder that is being written; a killed program leaves it behind."""
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
def durable_file(path: Path, temporary_folder: Path | None = None) -> Iterator[Path]:
    """Yield a temporary path, which becomes `path` on the disk if the block ends without an error.

    It is in `temporary_folder`, a folder of the same file system, by default that of `path`.
    """
    try:
        target = path.resolve() if path.is_symlink() else path
        is_special = target.exists() and not (target.is_file() or target.is_dir())
    except (OSError, RuntimeError) as error:  # RuntimeError: a loop of links, up to Python 3.12
        cause = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be written: {cause}") from error
    if is_special:
        raise InputError(f"{path}: cannot be written: it is not a regular file")
    # Some writers choose their format by the suffix.
    with temporary_path(temporary_folder or target.parent, path, suffix=target.suffix) as temporary:
        yield temporary
        sync(temporary)
        temporary.replace(target)
        sync(target.parent)


def write_text(path: Path, text: str) -> None:
    """Write a text file as `durable_file` does, in UTF-8 and with the line ends of `text`."""
    with durable_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")


@contextmanager
def temporary_path(
    temporary_folder: Path, path: Path, *, suffix: str = "", is_folder: bool = False
) -> Iterator[Path]:
    """Yield a new file or folder in `temporary_folder`, removed at the end; errors name `path`."""
    temporary = temporary_folder / f"{TEMPORARY_PREFIX}{os.urandom(8).hex()}{suffix}"
    try:
        # `tempfile` makes files that only their owner may read.
        temporary.mkdir() if is_folder else temporary.touch(exist_ok=False)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error
    try:
        yield temporary
    except OSError as error:
        cause = error.strerror or f"{error}; is the disk full?"
        raise InputError(f"{path}: cannot be written: {cause}") from error
    finally:
        if is_folder:
            shutil.rmtree(temporary, ignore_errors=True)
        else:
            with suppress(OSError):
                temporary.unlink()


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


@contextmanager
def durable_folder(folder: Path, names: Collection[str], marker: str) -> Iterator[Path]:
    """Yield a temporary folder whose files replace those called `names` in `folder`.

    The files are moved if the block ends without an error. The file `marker` is removed first and
    moved last: a folder that has it is complete.
    """
    folder = folder.resolve()
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: cannot be made: File exists")
    make_folder(folder.parent)
    is_new = not folder.exists()
    # Inside an existing folder: it may be a mount point, and no rename crosses file systems.
    with temporary_path(folder.parent if is_new else folder, folder, is_folder=True) as temporary:
        yield temporary
        for path in (*temporary.iterdir(), temporary):
            sync(path)
        if is_new:
            temporary.rename(folder)
            sync(folder.parent)
            return
        order = sorted(names, key=lambda name: name != marker)
        for name in order:
            (folder / name).unlink(missing_ok=True)
        for name in reversed(order):
            if (temporary / name).exists():
                (temporary / name).rename(folder / name)
        sync(folder)
