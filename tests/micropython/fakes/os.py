"""The file system, with a Pico's error number for a missing file."""

from uos import *
from uos import stat as _stat

_WASI_ENOENT = 44
_ENOENT = 2


def stat(path):
    try:
        return _stat(path)
    except OSError as error:
        raise OSError(_ENOENT if error.errno == _WASI_ENOENT else error.errno) from None
