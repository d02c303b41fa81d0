"""Reading input files: regular files of bounded size, never pipes or devices."""

import os
import stat
from collections.abc import Callable
from functools import lru_cache, wraps
from pathlib import Path
from typing import BinaryIO, TypeVar

from .errors import InputError

# Without O_NONBLOCK, opening a pipe without a writer blocks; without O_NOCTTY a terminal could
# become the controlling one. Windows has neither flag.
_FLAGS = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)

_PIECE_BYTES = 1 << 20

_Content = TypeVar("_Content")


def open_regular_file(path: Path, max_bytes: int) -> BinaryIO:
    """Open a regular file of at most `max_bytes` for reading; links to one are followed."""
    try:
        file = open(path, "rb", opener=_open)  # noqa: SIM115 - has an opener
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # NUL, or characters that no file name can hold
        raise InputError(f"{str(path)!r}: not a file name ({error})") from error
    status = os.fstat(file.fileno())
    if stat.S_ISREG(status.st_mode) and status.st_size <= max_bytes:
        return file
    file.close()
    if stat.S_ISREG(status.st_mode):
        raise _too_large(path, max_bytes)
    raise InputError(f"{path}: cannot be read: it is a pipe or a device; give a file")


def read_regular_file(path: Path, max_bytes: int) -> bytes:
    """Read a whole file of at most `max_bytes`, opened by `open_regular_file`."""
    with open_regular_file(path, max_bytes) as file:
        try:
            # The size that a file states may be wrong: it may grow, and files of /proc state 0.
            content = _read(file, max_bytes + 1)
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if len(content) > max_bytes:
        raise _too_large(path, max_bytes)
    return content


def _read(file: BinaryIO, most_bytes: int) -> bytes:
    """Read in pieces: one read of up to 1 GB would allocate 1 GB for any file."""
    pieces: list[bytes] = []
    while most_bytes > 0 and (piece := file.read(min(most_bytes, _PIECE_BYTES))):
        pieces.append(piece)
        most_bytes -= len(piece)
    return b"".join(pieces)


def _open(path: str, flags: int) -> int:
    """Open a file as `open` does, without blocking on a pipe or gaining a terminal."""
    return os.open(path, flags | _FLAGS)


def _too_large(path: Path, max_bytes: int) -> InputError:
    return InputError(f"{path}: larger than {max_bytes} bytes, the limit for this file")


def read_once(files: int) -> Callable[[Callable[[Path], _Content]], Callable[[Path], _Content]]:
    """Decorate a reader: the contents of the last `files` files are kept while these are unchanged.

    A file with the same modification time and size counts as unchanged.
    """

    def decorate(read: Callable[[Path], _Content]) -> Callable[[Path], _Content]:
        @lru_cache(maxsize=files)
        def cached(path: Path, _mtime_ns: int, _size: int) -> _Content:
            return read(path)

        @wraps(read)
        def read_if_changed(path: Path) -> _Content:
            try:
                status = path.stat()
            except OSError:
                return read(path)  # which raises the error
            return cached(path, status.st_mtime_ns, status.st_size)

        return read_if_changed

    return decorate
