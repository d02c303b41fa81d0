"""Threads and memory of a process that works on one frame after the other."""

from __future__ import annotations

import ctypes
import os
import sys

__all__ = ["settle_process"]

_SPINS = "10000"
# Names and numbers of mallopt(3).
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_KEPT_BYTES = 256 * 2**20
_LARGEST_BYTES = 32 * 2**20  # the most that glibc takes


def settle_process() -> None:
    """Let threads sleep between kernels, and keep memory for the next frame; children do the same.

    To be called before numba starts its threads. GNU OpenMP lets a thread that has nothing to do
    spin for some milliseconds, on the core that the next transform needs; here it waits for the
    next kernel for some hundred microseconds, and then sleeps. The GNU C library gives
    the memory of a frame back to the system at once, and asking for its pages anew takes longer
    than most of what is then done with them. Whoever has set the variables for these is obeyed;
    other systems do not know them.
    """
    if "OMP_WAIT_POLICY" not in os.environ:
        os.environ.setdefault("GOMP_SPINCOUNT", _SPINS)
    for variable, option, size in (
        ("MALLOC_TRIM_THRESHOLD_", _M_TRIM_THRESHOLD, _KEPT_BYTES),
        ("MALLOC_MMAP_THRESHOLD_", _M_MMAP_THRESHOLD, _LARGEST_BYTES),
    ):
        if variable in os.environ:
            continue
        os.environ[variable] = str(size)
        # Variables are read when a process begins: this one has to be told.
        mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
        if mallopt is not None:
            mallopt(option, size)
