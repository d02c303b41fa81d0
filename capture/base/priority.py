"""The priority of this process."""

import os
from contextlib import suppress

_LOWEST = 19


def yield_processors() -> None:
    """Compute from now on only while no other process wants the processor.

    Call it before the process starts threads.
    """
    if hasattr(os, "setpriority"):
        os.setpriority(os.PRIO_PROCESS, 0, _LOWEST)
    if hasattr(os, "SCHED_IDLE"):  # gives way at once; the lowest priority goes on for up to 3 ms
        with suppress(OSError):  # a sandbox may forbid it
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
