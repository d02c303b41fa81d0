"""Signals that end a command: SIGINT, SIGTERM, and on POSIX SIGHUP and SIGQUIT.

Before a command a signal ends the process at once. During a command it raises KeyboardInterrupt in
the main thread, so that LEDs go out and temporary files are removed. After a command it is ignored
for five seconds, in which the process ends by itself.

This module imports little, because a signal before `install_handlers` ends in a traceback.
"""

from __future__ import annotations

import atexit
import math
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

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
# Delay until an interrupt that could not be raised is tried again; too short to be noticed.
_RETRY_S = 0.01
_AT_ONCE, _NEVER = -math.inf, math.inf

# Time after which a signal ends the process: _AT_ONCE before a command, _NEVER in a command until
# its first interrupt, and the end of the clean-up after that or after its end.
_exit_after_s = _AT_ONCE
_last_signal: int = signal.SIGINT
_was_interrupted = False


def install_handlers() -> None:
    """Handle the signals that end a command, except those that the parent ignores, as ``nohup``."""
    for number in _ENDING:
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            signal.signal(number, _handle)
    sys.unraisablehook = _handle_lost
    # Registered first, so called last: afterwards Python removes its signal handlers.
    atexit.register(_ignore_signals)


def _ignore_signals() -> None:
    """Ignore signals from now on; if Python hangs after this, only SIGKILL ends the process."""
    for number in _ENDING:
        if signal.getsignal(number) is _handle:
            signal.signal(number, signal.SIG_IGN)


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt in the block when a signal arrives, once.

    Further signals are ignored while the block cleans up, for at most five seconds.
    """
    global _exit_after_s
    _exit_after_s = _NEVER
    try:
        yield
    finally:
        _exit_after_s = min(_exit_after_s, time.monotonic() + _CLEANUP_S)


def _handle(number: int, frame: FrameType | None) -> None:
    global _exit_after_s, _last_signal, _was_interrupted
    now_s = time.monotonic()
    if now_s > _exit_after_s:
        with suppress(OSError):
            os.write(2, f"{INTERRUPTED_LINE}\n".encode())
        os._exit(INTERRUPTED_STATUS)
    if _exit_after_s < _NEVER:
        return  # the command cleans up
    _last_signal = number
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            # Modules of other libraries catch every exception while they are imported.
            _retry_later()
            return
        frame = frame.f_back
    _exit_after_s = now_s + _CLEANUP_S
    _was_interrupted = True
    raise KeyboardInterrupt


def _handle_lost(lost: sys.UnraisableHookArgs) -> None:
    """Retry an interrupt that Python lost in a finalizer or a callback from C; report the rest.

    An object whose constructor was interrupted may lack attributes that its finalizer uses, as
    those of llvmlite do while numba loads a kernel: that is not reported.
    """
    global _exit_after_s
    if issubclass(lost.exc_type, KeyboardInterrupt):
        if _exit_after_s > _AT_ONCE:
            _exit_after_s = _NEVER
            _retry_later()
    elif not (_was_interrupted and issubclass(lost.exc_type, AttributeError)):
        sys.__unraisablehook__(lost)


def _retry_later() -> None:
    """Raise the last signal again in a moment."""
    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(_last_signal))
        signal.setitimer(signal.ITIMER_REAL, _RETRY_S)
        # SIGALRM would kill the process once Python has removed this handler.
        atexit.register(signal.setitimer, signal.ITIMER_REAL, 0.0)
    else:  # Windows
        import _thread
        import threading

        threading.Timer(_RETRY_S, _thread.interrupt_main, (_last_signal,)).start()
