"""Replacing a folder of result files as a whole: a reader never meets files of two results."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import secrets
import shutil
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .durable_file import make_folder
from .errors import InputError

__all__ = ["durable_folder"]

_PREFIX = ".writing-folder-"
# A younger folder may belong to a process that has made it and not locked it yet.
_NEW_S = 60.0
# From linux/fcntl.h and linux/fs.h.
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2


@contextmanager
def durable_folder(folder: Path, names: Collection[str], first: str) -> Iterator[Path]:
    """Yield a temporary folder whose files take their place in `folder` when the block ends well.

    If `folder` is missing, empty or holds only files called `names`, the change is one step. If it
    holds anything else, that stays: then the files called `names` are removed, `first` as the first
    of them, and the new ones moved in, `first` as the last. In both cases files of an old result
    never lie beside those of a new one. If the block raises, `folder` stays as it was.

    Raises
    ------
    InputError
        If the folder cannot be made or written to.
    """
    folder = folder.resolve()
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: cannot be made: File exists")
    make_folder(folder.parent)
    # A mount point cannot be renamed, and its files only within it.
    inside = folder.exists() and (
        os.path.ismount(folder) or not os.access(folder.parent, os.W_OK | os.X_OK)
    )
    home = folder if inside else folder.parent
    temporary = home / f"{_PREFIX}{secrets.token_hex(8)}"
    lock = None
    try:
        _remove_abandoned(home)
        temporary.mkdir()
        lock = _locked(temporary)
        yield temporary
        for path in (*temporary.iterdir(), temporary):
            _sync(path)
        if inside or not _swapped(temporary, folder, names):
            order = sorted(names, key=lambda name: name != first)
            for name in order:
                (folder / name).unlink(missing_ok=True)
            for name in reversed(order):
                if (temporary / name).exists():
                    (temporary / name).rename(folder / name)
        _sync(folder)
        _sync(home)
    except OSError as error:
        cause = error.strerror or f"{error}; is the disk full?"
        raise InputError(f"{folder}: cannot be written: {cause}") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def _swapped(new: Path, folder: Path, names: Collection[str]) -> bool:
    """Put `new` in the place of `folder` in one step; False if that would lose other files."""
    if not folder.exists():
        new.rename(folder)
        return True
    # A shell or program that stands in the folder would be left in one that is gone.
    if folder.samefile(Path.cwd()):
        return False
    if not all(entry.is_file() and entry.name in names for entry in folder.iterdir()):
        return False
    try:
        _exchange(new, folder)
    except OSError as error:
        if error.errno not in (errno.ENOSYS, errno.EINVAL):
            raise
        # Not every file system exchanges: between these two steps there is no folder.
        old = new.with_name(f"{new.name}-old")
        folder.rename(old)
        new.rename(folder)
        old.rename(new)
    return True


def _exchange(one: Path, other: Path) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if not hasattr(libc, "renameat2"):
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))
    failed = libc.renameat2(
        _AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), ctypes.c_uint(_RENAME_EXCHANGE)
    )
    if failed:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))


def _remove_abandoned(home: Path) -> None:
    """Remove temporary folders of processes that were killed: nobody holds their locks."""
    for path in home.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime < _NEW_S:
                continue
            lock = _locked(path)
            shutil.rmtree(path, ignore_errors=True)
            os.close(lock)


def _locked(folder: Path) -> int:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
