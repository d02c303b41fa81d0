"""`PrivateFile`: JSON with secrets that only its owner may read."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import BaseModel

from capture.base.folder_lock import file_lock
from classify.base.durable_file import durable_file
from classify.base.errors import InputError
from classify.base.models import validated
from classify.base.regular_file import read_regular_file

# A thousand users or clients have 200 kB.
_MAX_BYTES = 1 << 20
OWNER_ONLY = 0o600
# A change takes 10 ms; a disk that is busy, a second.
TIMEOUT_S = 10.0

_Model = TypeVar("_Model", bound=BaseModel)


class PrivateFile(Generic[_Model]):
    """A file that holds a `model`, read again when another program replaced it. Thread-safe."""

    def __init__(
        self, path: Path, model: type[_Model], remedy: str = "restore it from a backup"
    ) -> None:
        self._path, self._model, self._remedy = path, model, remedy
        self._changing = threading.Lock()
        self._lock = threading.Lock()
        self._stamp: tuple[int, int, int] | None = None
        self._known: _Model | None = None

    @contextmanager
    def changing(self) -> Iterator[None]:
        """Keep other threads and programs from changing the file during the block."""
        with self._changing, file_lock(self._path, TIMEOUT_S):
            yield

    def read(self) -> _Model:
        """Return the contents of the file; a missing one is an empty object."""
        with self._lock:
            stamp = self._present_stamp()
            if self._known is None or stamp != self._stamp:
                self._known, self._stamp = None, stamp
                self._known = self._read()
            return self._known

    def write(self, value: _Model) -> None:
        """Replace the file; only its owner may read it."""
        with durable_file(self._path) as temporary:
            temporary.chmod(OWNER_ONLY)  # before it has contents
            temporary.write_text(value.model_dump_json(indent=1) + "\n", encoding="utf-8")

    def _read(self) -> _Model:
        try:
            values: Any = json.loads(read_regular_file(self._path, _MAX_BYTES))
        except InputError as error:
            if not isinstance(error.__cause__, FileNotFoundError):
                raise
            values = {}
        except (ValueError, RecursionError) as error:
            raise InputError(f"{self._path}: damaged: {error}; {self._remedy}") from error
        return validated(values, self._model, str(self._path))

    def _present_stamp(self) -> tuple[int, int, int] | None:
        """Return a stamp that changes when the file is replaced; None if it is missing."""
        try:
            status = self._path.stat()
        except OSError:
            return None
        return status.st_ino, status.st_mtime_ns, status.st_size
