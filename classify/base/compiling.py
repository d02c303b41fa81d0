"""Compile numeric kernels, and cache the machine code on disk where possible."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba import njit

from .arrays import Array as Array
from .kernel_cache import KernelCache

# NaN and infinity stay exact, and so does the order of sums: with "reassoc" a kernel that numba
# has just compiled and the same kernel from the cache differ in the last digits
# (tests/classify/test_repeatable.py).
_FASTMATH = {"contract", "arcp", "nsz"}


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function when it is first called, cached on disk, and release the GIL.

    `numba.prange` is not used: it takes three to four times as long to compile.
    """
    compiled: Callable[..., Any] = njit(nogil=True, fastmath=_FASTMATH, error_model="numpy")(
        function
    )
    dispatcher: Any = compiled
    with suppress(RuntimeError, OSError):
        dispatcher._cache = KernelCache(function)
    return compiled


def kernel_cache_folder() -> Path | None:
    """Folder in which compiled kernels are cached, or None if they are not.

    The first that can be written to: in `NUMBA_CACHE_DIR`, `__pycache__` here, the user's cache.
    """
    path = _probe.stats.cache_path  # type: ignore[attr-defined]
    return None if path is None else Path(path)


@kernel
def _probe() -> None:
    """Do nothing; `kernel_cache_folder` reads where this kernel is cached."""
