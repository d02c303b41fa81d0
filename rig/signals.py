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
    # The handlers are replaced. A signal mask would not do: the kernel delivers the signal to
    # another thread, and Python then runs its handler in this one.
    if threading.current_thread() is not threading.main_thread():
        yield  # Python runs handlers in the main thread only
        return
    held: list[int] = []
    # `getsignal` returns None for a handler that was not installed from Python.
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
