"""Worker processes on this machine."""

import _thread
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import NoReturn, TypeVar

# Time for an interrupted worker to remove its temporary files, which takes milliseconds.
_CLEANUP_S = 1
# Set while a worker process has an item: it may have temporary files to remove when it ends.
_at_work = threading.Event()
_one_at_a_time = threading.Lock()

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


class LocalPool:
    """Processes of one thread each."""

    # The workers end when their pipe from this process closes, even if this process was killed.

    attempts = 3  # number of workers that may die with an item before it raises InputError
    # Exceptions of a future whose worker died.
    death_types: tuple[type[Exception], ...] = (BrokenExecutor,)

    def __init__(self, workers: int) -> None:
        self.workers = workers  # items that run at a time
        # Submitted items: the other workers need some while the first one in order takes long.
        self.in_flight = 4 * workers
        self._start()

    def submit(self, function: Callable[[_Item], _Result], item: _Item) -> Future[_Result]:
        try:
            with _terminal_signals_blocked():
                return self._executor.submit(_call, function, item)
        except OSError as error:
            # A broken pipe: the new worker was killed before it read its instructions.
            raise BrokenExecutor("a worker died while it was being started") from error

    def renew(self) -> None:
        """Start new workers; the submitted items are forgotten."""
        self.abort()
        self._start()

    def close(self) -> None:
        """End the workers, which are idle."""
        self._executor.shutdown()
        self._lifeline.close()

    def abort(self) -> None:
        """Interrupt the running items and end the workers."""
        self._lifeline.close()
        self._executor.shutdown(cancel_futures=True)

    def _start(self) -> None:
        # A forked process would inherit locks that threads of numba and OpenCV hold.
        context = get_context("spawn")
        far_end, self._lifeline = context.Pipe(duplex=False)
        with _terminal_signals_blocked():
            self._executor = ProcessPoolExecutor(
                self.workers,
                mp_context=context,
                initializer=_begin_worker,
                initargs=(far_end,),
            )


@contextmanager
def _terminal_signals_blocked() -> Iterator[None]:
    """Block a terminal's signals for processes started in the block."""
    # These are the workers, which this process ends itself, and the resource tracker.
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    terminal = {signal.SIGINT, signal.SIGHUP, signal.SIGQUIT}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, terminal)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_worker(lifeline: Connection) -> None:
    """Prepare a worker that ends with the process which holds the other end of `lifeline`."""
    signal.signal(signal.SIGTERM, _end_worker)
    threading.Thread(target=_end_when_closed, args=(lifeline,), daemon=True).start()
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Imported before the first item: an interrupted import would print that numpy is missing.
    import cv2  # noqa: F401


def _end_when_closed(lifeline: Connection) -> None:
    try:
        lifeline.recv_bytes()
    except (EOFError, OSError):
        if hasattr(signal, "alarm"):
            os.kill(os.getpid(), signal.SIGTERM)
            return
        # On Windows os.kill ends the process at once, and no signal wakes a waiting thread.
        if _at_work.is_set():
            _thread.interrupt_main(signal.SIGTERM)
            time.sleep(_CLEANUP_S)
        os._exit(1)


def _end_worker(*_: object) -> NoReturn:
    if not _at_work.is_set():
        # An exception in an import or in the executor would print a traceback.
        os._exit(1)
    # SIGALRM ends the process if compiled code does not return to Python.
    if hasattr(signal, "alarm"):
        signal.alarm(_CLEANUP_S)
    # The exception lets the code in between remove its temporary files.
    raise SystemExit(1)


def load_tasks(_: None) -> None:
    """Import the modules that the first item of a worker needs."""
    from . import tasks  # noqa: F401


def _call(function: Callable[[_Item], _Result], item: _Item) -> _Result:
    _at_work.set()
    try:
        return call_in_one_thread(function, item)
    except SystemExit:
        # The executor would return the exception as the item's result and continue.
        os._exit(1)
    finally:
        _at_work.clear()


def call_in_one_thread(function: Callable[[_Item], _Result], item: _Item) -> _Result:
    """Return ``function(item)``, computed in one thread: each core has its own worker."""
    import cv2

    from classify.base.threads import set_thread_count

    with _one_at_a_time:  # the settings hold for the whole process: threads of Dask take turns
        set_thread_count(1)
        cv2.setNumThreads(1)
        return function(item)
