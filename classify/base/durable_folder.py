"""Replace a folder of result files so that no reader sees files of two results."""

import ctypes
import os
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from .durable_file import locked_temporary, make_folder, sync
from .errors import InputError

# From linux/fcntl.h and linux/fs.h.
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2


@contextmanager
def durable_folder(folder: Path, names: Collection[str], first: str) -> Iterator[Path]:
    """Yield a temporary folder whose files move to `folder` when the block ends well.

    If `folder` is missing or holds only files called `names`, both are exchanged in one step; else
    its old files are removed, `first` first, and the new ones moved in, `first` last.
    """
    folder = folder.resolve()
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: cannot be made: File exists")
    make_folder(folder.parent)
    # A mount point cannot be renamed, and its files can be renamed only inside it.
    inside = folder.exists() and (
        os.path.ismount(folder) or not os.access(folder.parent, os.W_OK | os.X_OK)
    )
    home = folder if inside else folder.parent
    with locked_temporary(home, folder, is_folder=True) as temporary:
        yield temporary
        for path in (*temporary.iterdir(), temporary):
            sync(path)
        if inside or not _exchanged(temporary, folder, names):
            order = sorted(names, key=lambda name: name != first)
            for name in order:
                (folder / name).unlink(missing_ok=True)
            for name in reversed(order):
                if (temporary / name).exists():
                    (temporary / name).rename(folder / name)
        sync(folder)
        sync(home)


def _exchanged(new: Path, folder: Path, names: Collection[str]) -> bool:
    """Exchange `new` and `folder` in one step; False if impossible or unsafe."""
    if not folder.exists():
        new.rename(folder)
        return True
    # A shell or program whose working folder this is would be left in a removed one.
    if folder.samefile(Path.cwd()):
        return False
    if not all(entry.is_file() and entry.name in names for entry in folder.iterdir()):
        return False
    if sys.platform == "win32":  # has no list of all loaded libraries
        return False
    paths = (_AT_FDCWD, os.fsencode(new), _AT_FDCWD, os.fsencode(folder))
    # Not every C library and file system can exchange two folders.
    exchange = getattr(ctypes.CDLL(None), "renameat2", None)
    return exchange is not None and exchange(*paths, ctypes.c_uint(_RENAME_EXCHANGE)) == 0
