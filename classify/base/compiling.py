"""Compile numeric kernels, and keep the machine code on disk while it is whole and current."""

import hashlib
import logging
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache, IndexDataCacheFile

from .arrays import Array as Array

_log = logging.getLogger(__name__)


class _KernelCache(FunctionCache):
    """The machine code of one kernel, by argument types; after a failure it is compiled again."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        locator = self._impl.locator
        # numba compares the kernel's own file only. Kernels and constants of other files are
        # compiled into it, and after an upgrade the old code of those would be used.
        stamp = (locator.get_source_stamp(), _kernel_sources())
        self._cache_file = _CodeFiles(self._cache_path, self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load compiled code; log the first time that there is none."""
        code = super().load_overload(sig, target_context)
        if code is None:
            _announce_compilation(self.cache_path)
        return code

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled code, unless the disk is full."""
        with suppress(OSError):
            super().save_overload(sig, data)


class _CodeFiles(IndexDataCacheFile):
    """An index, and files of machine code named by the hash of their content.

    numba would number the files. After a kill, a file of older source could have a current number,
    and would run without an error.
    """

    def __init__(self, folder: str, kernel_name: str, source_stamp: object) -> None:
        super().__init__(folder, kernel_name, source_stamp)
        self._folder, self._kernel_name = Path(folder), kernel_name

    def save(self, key: Any, data: Any) -> None:
        content = self._dump(data)
        name = self._name_of(content)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(content)
        index = self._load_index() | {key: name}
        self._save_index(index)
        for path in self._folder.glob(f"{self._kernel_name}.*.nbc"):
            if path.name not in index.values():
                path.unlink(missing_ok=True)

    def load(self, key: Any) -> Any:
        name = self._load_index().get(key)
        if name is None:
            return None
        try:
            content = (self._folder / name).read_bytes()
            return self._load_data(name) if self._name_of(content) == name else None
        except OSError:  # another program may remove it between the two reads
            return None

    def _load_index(self) -> dict[Any, str]:
        try:
            index: dict[Any, str] = super()._load_index()
        except Exception:  # of any type: a loss of power may have truncated the file
            return {}
        return index

    def _name_of(self, content: bytes) -> str:
        return f"{self._kernel_name}.{hashlib.sha256(content).hexdigest()[:16]}.nbc"


@lru_cache(maxsize=1)
def _announce_compilation(folder: str) -> None:
    _log.info("compiling for this processor, once; kept in %s", folder)


@lru_cache(maxsize=1)
def _kernel_sources() -> bytes:
    """Digest of the files that define kernels or their constants (test_compiling.py)."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        source = path.read_bytes()
        if b"@kernel" in source or path.name == "shadow_rule.py":
            digest.update(source)
    return digest.digest()


# NaN and infinity stay exact, and so does the order of sums: with "reassoc" a kernel that numba
# has just compiled and the same kernel from the cache differ in the last digits
# (tests/classify/test_repeatable.py).
_FASTMATH = {"contract", "arcp", "nsz"}


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function when it is first called, cached on disk, and release the GIL."""
    compiled: Callable[..., Any] = njit(nogil=True, fastmath=_FASTMATH, error_model="numpy")(
        function
    )
    dispatcher: Any = compiled
    with suppress(RuntimeError, OSError):
        dispatcher._cache = _KernelCache(function)
    return compiled


def kernel_part(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function into each kernel that calls it, so that their loops are vectorised."""
    inlined: Callable[..., Any] = njit(
        nogil=True, fastmath=_FASTMATH, error_model="numpy", forceinline=True
    )(function)
    return inlined


def kernel_cache_folder() -> Path | None:
    """Folder in which compiled kernels are cached, or None if they are not."""
    path = _probe.stats.cache_path  # type: ignore[attr-defined]
    return None if path is None else Path(path)


@kernel
def _probe() -> None:
    """Do nothing; `kernel_cache_folder` reads where this kernel is cached."""
