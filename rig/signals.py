"""Hold signals back during actions such as putting LEDs out."""

import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

# Windows has only the first two.
_ENDING = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
    if hasattr(signal, name)
]


def uninterrupted(action: Callable[[], object]) -> None:
    """Run `action` to its end, and deliver signals that end a program only afterwards.

    An interrupt that arrives before the signals are held back runs `action` again, so it must be
    harmless to repeat. It needs its own deadlines, since Ctrl-C does not end it.
    """
    try:
        with signals_held_back():
            action()
    except KeyboardInterrupt:
        with signals_held_back():
            action()
        raise


@contextmanager
def signals_held_back() -> Iterator[None]:
    """Hold back signals that end a program, and handle them at the end of the block.

    The handlers are exchanged, because a mask is not enough: the kernel delivers a masked signal to
    another thread, and Python then runs the handler in this one.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # Python runs handlers in the main thread only
        return
    held: list[int] = []
    handlers = {number: signal.getsignal(number) for number in _ENDING}
    masked = _masked("SIG_BLOCK", ())
    try:
        _masked("SIG_BLOCK", _ENDING)
        for number, handler in handlers.items():
            if handler not in (signal.SIG_IGN, None):  # None: not installed from Python
                signal.signal(number, lambda number, _frame: held.append(number))
        _masked("SIG_SETMASK", masked)
        yield
    finally:
        _masked("SIG_BLOCK", _ENDING)
        for number, handler in handlers.items():
            if handler not in (signal.SIG_IGN, None):
                signal.signal(number, handler)
        for arrived in dict.fromkeys(held):
            signal.raise_signal(arrived)  # pending until the mask is restored
        _masked("SIG_SETMASK", masked)


def _masked(change: str, numbers: Iterable[int]) -> set[signal.Signals]:
    """Change the mask of this thread, and return it as it was. Windows has no mask."""
    if not hasattr(signal, "pthread_sigmask"):
        return set()
    return signal.pthread_sigmask(getattr(signal, change), numbers)  # type: ignore[return-value]
