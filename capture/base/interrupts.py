"""Signals that end a command: SIGINT, SIGTERM, and on POSIX SIGHUP and SIGQUIT.

In a command the first one raises KeyboardInterrupt in the main thread, so that LEDs go out and
temporary files are removed. Further ones are ignored for five seconds; after that, one ends the
process at once. So does a signal before or after a command, or during an import: then the
controller's watchdog puts LEDs out.

This module imports little, because a signal before `install_handlers` ends in a traceback.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import CodeType, FrameType

# Windows has only the first two.
_ENDING = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
    if hasattr(signal, name)
]
INTERRUPTED_STATUS = 130  # 128 + SIGINT, as shells report it
INTERRUPTED_LINE = "ps4rig: interrupted"
# Time for a command to clean up undisturbed. It covers the time-outs of a controller that no longer
# answers (rig.toml's defaults).
_CLEANUP_S = 5.0
# Prefix of llvmlite's callbacks for compiled code. ctypes swallows every exception in them, so the
# signal is sent again after `_AFTER_CALLBACK_S`.
_CALLBACK_PREFIX = "_raw_object_cache_"
_AFTER_CALLBACK_S = 0.01

_is_in_command = False
_cleanup_ends_s = 0.0  # after the first signal of a command, else 0


def install_handlers() -> None:
    """Handle the signals that end a command, except those that the parent ignores, as ``nohup``."""
    for number in _ENDING:
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            signal.signal(number, _handle)
            # At exit Python restores the default actions: a late signal would replace the status.
            atexit.register(signal.signal, number, signal.SIG_IGN)


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt in the block when a signal arrives, once."""
    global _is_in_command, _cleanup_ends_s
    _is_in_command, _cleanup_ends_s = True, 0.0
    try:
        yield
    finally:
        _is_in_command = False


def _handle(number: int, frame: FrameType | None) -> None:
    global _cleanup_ends_s
    now_s, running = time.monotonic(), [*_running_code(frame)]
    if now_s < _cleanup_ends_s:
        return
    # Some modules catch every exception while they are imported.
    is_in_import = any(code.co_filename.startswith("<frozen importlib") for code in running)
    is_after_cleanup = _cleanup_ends_s > 0.0
    if is_after_cleanup or not _is_in_command or is_in_import:
        with suppress(OSError):
            os.write(2, f"{INTERRUPTED_LINE}\n".encode())
        os._exit(INTERRUPTED_STATUS)
    if any(code.co_name.startswith(_CALLBACK_PREFIX) for code in running):
        threading.Timer(_AFTER_CALLBACK_S, _signal_main_thread, (number,)).start()
        return
    _cleanup_ends_s = now_s + _CLEANUP_S
    # The destructor of an object that is half made now may fail: Python would print its traceback.
    sys.unraisablehook = lambda _: None
    raise KeyboardInterrupt


def _signal_main_thread(number: int) -> None:
    """Send a signal that also ends a wait of the main thread, where the system can."""
    main = threading.main_thread().ident
    if main is not None and hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main, number)
    else:
        signal.raise_signal(number)


def _running_code(frame: FrameType | None) -> Iterator[CodeType]:
    """Code of the functions that run, from the innermost."""
    while frame is not None:
        yield frame.f_code
        frame = frame.f_back
