"""Replacing a folder of result files as a whole: a reader never meets files of two results."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import secrets
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .durable_file import make_folder, sync
from .errors import InputError

__all__ = ["durable_folder"]

_PREFIX = ".writing-folder-"
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
    try:
        _remove_abandoned(home)
        temporary, lock = _locked_folder(home)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from error
    try:
        yield temporary
        for path in (*temporary.iterdir(), temporary):
            sync(path)
        if inside or not _swapped(temporary, folder, names):
            order = sorted(names, key=lambda name: name != first)
            for name in order:
                (folder / name).unlink(missing_ok=True)
            for name in reversed(order):
                if (temporary / name).exists():
                    (temporary / name).rename(folder / name)
        sync(folder)
        sync(home)
    except OSError as error:
        cause = error.strerror or f"{error}; is the disk full?"
        raise InputError(f"{folder}: cannot be written: {cause}") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
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
    except OSError:
        # Not every file system can exchange. Between these two steps there is no folder.
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


def _locked_folder(home: Path) -> tuple[Path, int]:
    """Make a temporary folder, and lock it for as long as the descriptor is open."""
    while True:
        temporary = home / f"{_PREFIX}{secrets.token_hex(8)}"
        temporary.mkdir()
        lock = os.open(temporary, os.O_RDONLY | os.O_DIRECTORY)
        # File systems without locks: the folder is not removed after a kill either.
        with suppress(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX)
        # Another writer may have taken the folder for abandoned before it was locked.
        if temporary.exists():
            return temporary, lock
        os.close(lock)


def _remove_abandoned(home: Path) -> None:
    """Remove temporary folders that no writer holds a lock on."""
    for path in home.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            lock = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(path)
            finally:
                os.close(lock)
