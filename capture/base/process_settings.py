"""Memory, threads and priority of a process that works on many frames."""

import ctypes
import gc
import os
import sys
from contextlib import suppress
from pathlib import Path

from classify.base.threads import bind_workers, thread_count

# Names and numbers of mallopt(3).
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
# Freed memory that the process keeps: the maps of a frame of several megapixels.
_TRIM_BYTES = 256 * 2**20
_MMAP_BYTES = 32 * 2**20  # the largest value that glibc accepts
# Time for which a thread that returns from a kernel waits for another one that computes in Python;
# by default 5 ms. capture/DECISIONS.md has the gain.
_SWITCH_S = 0.5e-3


def configure_process() -> None:
    """Set up memory and threads of the process; call it before numpy is imported.

    Variables of the environment take precedence.
    """
    # Checked here, because numba prints a traceback if NUMBA_NUM_THREADS is wrong or blank.
    if os.environ.get("NUMBA_NUM_THREADS", "").strip():
        thread_count()
    else:
        os.environ.pop("NUMBA_NUM_THREADS", None)
    # One thread for BLAS: several wait for one another in busy loops, and beside other threads need
    # ten times as long for a product of a few vectors.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.setswitchinterval(_SWITCH_S)
    # By default glibc returns the memory of each frame to the system, and new pages cost more time
    # than most operations on them.
    for variable, option, size in (
        ("MALLOC_TRIM_THRESHOLD_", _M_TRIM_THRESHOLD, _TRIM_BYTES),
        ("MALLOC_MMAP_THRESHOLD_", _M_MMAP_THRESHOLD, _MMAP_BYTES),
        # All threads then share one arena, which keeps freed memory; the arenas of other threads
        # ignore the thresholds.
        ("MALLOC_ARENA_MAX", _M_ARENA_MAX, 1),
    ):
        if variable in os.environ:
            continue
        os.environ[variable] = str(size)
        # glibc reads the variables at the start of a process, so only child processes see them.
        mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
        if mallopt is not None:
            mallopt(option, size)


def configure_station_process() -> None:
    """Set up the process of a station; call it when all modules are loaded."""
    import cv2

    gc.freeze()  # a garbage collection that includes the modules takes 0.1 s
    # Threads of OpenCV wait in busy loops too, and take processors from the threads that judge.
    cv2.setNumThreads(1)
    bind_workers()


_LOWEST_PRIORITY = 19


def yield_processors() -> None:
    """Give way to all other processes; call it before the process starts threads."""
    if hasattr(os, "setpriority"):
        os.setpriority(os.PRIO_PROCESS, 0, _LOWEST_PRIORITY)
    if hasattr(os, "SCHED_IDLE"):  # gives way at once; the lowest priority goes on for up to 3 ms
        with suppress(OSError):  # a sandbox may forbid it
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def resident_bytes() -> int | None:
    """Resident memory of this process; None on systems without ``/proc``."""
    status = Path("/proc/self/status")
    if not status.exists():
        return None
    fields = dict(line.split(":", 1) for line in status.read_text(errors="replace").splitlines())
    return 1024 * int(fields["VmRSS"].split()[0])  # "kB" in /proc is 1024 bytes
