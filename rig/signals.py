"""Hold signals back during actions such as putting LEDs out."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

# Windows has only the first two.
_ENDING = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
    if hasattr(signal, name)
]


@contextmanager
def signals_held_back() -> Iterator[None]:
    """Hold back signals that end a program until the block ends."""
    # By their handlers: the kernel delivers a masked signal to another thread, and Python runs its
    # handler here.
    if threading.current_thread() is not threading.main_thread():
        yield  # Python runs handlers in the main thread only
        return
    held: list[int] = []
    # None is a handler that was not installed from Python.
    handlers = {
        number: handler
        for number in _ENDING
        if (handler := signal.getsignal(number)) not in (signal.SIG_IGN, None)
    }
    try:
        for number in handlers:
            signal.signal(number, lambda number, _frame: held.append(number))
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number in dict.fromkeys(held):
            signal.raise_signal(number)
