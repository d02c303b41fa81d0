"""Signals that end a command: SIGINT, SIGTERM, SIGHUP and SIGQUIT.

Before and after a command a signal ends the process at once. During a command it raises
KeyboardInterrupt in the main thread, so that LEDs go out and temporary files are removed.

This module imports little, because a signal before `install_handlers` ends in a traceback.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

__all__ = ["INTERRUPTED_LINE", "INTERRUPTED_STATUS", "install_handlers", "interruptible"]

INTERRUPTED_STATUS = 130  # 128 + SIGINT, as shells report it
INTERRUPTED_LINE = "ps4rig: interrupted"
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
# Time for a command to clean up undisturbed. It covers the time-outs of a controller that no longer
# answers (rig.toml's defaults). A signal after that ends the process at once.
_CLEANUP_S = 5.0
# Delay until an interrupt that could not be raised is tried again; too short to be noticed.
_RETRY_S = 0.01

_command_runs = False
_raised_at_s: float | None = None


def install_handlers() -> None:
    """Handle the signals that end a command, except those that the parent process ignores.

    ``nohup`` ignores SIGHUP, and a shell ignores SIGINT for jobs in the background.
    """
    for number in _SIGNALS:
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            signal.signal(number, _handle)
    sys.unraisablehook = _retry_lost_interrupt


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt in the block when a signal arrives, once.

    Further signals are ignored while the block cleans up, for at most five seconds.
    """
    global _command_runs, _raised_at_s
    _raised_at_s = None
    _command_runs = True
    try:
        yield
    finally:
        _command_runs = False


def _handle(number: int, frame: FrameType | None) -> None:
    global _raised_at_s
    now_s = time.monotonic()
    if not _command_runs or (_raised_at_s is not None and now_s > _raised_at_s + _CLEANUP_S):
        with suppress(OSError):
            os.write(2, f"{INTERRUPTED_LINE}\n".encode())
        os._exit(INTERRUPTED_STATUS)
    if _raised_at_s is not None:
        return
    if _is_importing(frame):
        # Modules of other libraries catch every exception while they are imported.
        _send_again(number)
        return
    _raised_at_s = now_s
    raise KeyboardInterrupt


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _send_again(number: int) -> None:
    import threading

    timer = threading.Timer(_RETRY_S, os.kill, (os.getpid(), number))
    timer.daemon = True
    timer.start()


def _retry_lost_interrupt(lost: sys.UnraisableHookArgs) -> None:
    """Raise an interrupt again that Python lost in a finalizer or a callback from C."""
    global _raised_at_s
    if issubclass(lost.exc_type, KeyboardInterrupt):
        _raised_at_s = None
        _send_again(signal.SIGINT)
    else:
        sys.__unraisablehook__(lost)
