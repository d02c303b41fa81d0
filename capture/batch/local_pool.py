"""Worker processes on this machine."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import NoReturn, TypeVar

from .one_thread import call_in_one_thread

__all__ = ["LocalPool"]

# How long an interrupted worker may take to put its temporary files away.
_GRACE_S = 1

Item = TypeVar("Item")
Result = TypeVar("Result")


class LocalPool:
    """A `batch.Pool` of processes, each with one thread.

    They are spawned and not forked: a fork copies the locks of numba's and OpenCV's threads as
    they happen to be. They end with this process, whatever it ends of: each waits at the far end
    of a pipe for nothing but its closing.
    """

    attempts = 3
    died: tuple[type[Exception], ...] = (BrokenExecutor,)

    def __init__(self, workers: int) -> None:
        self.workers = workers
        # While the first in order takes its time, the others have some more to do.
        self.in_flight = 4 * workers
        self._start()

    def submit(self, function: Callable[[Item], Result], item: Item) -> Future[Result]:
        """Have a worker call the function; the worker may be started for it."""
        # A terminal sends Ctrl-C to all its processes, but only this one is to act on it. What is
        # blocked here stays blocked in a process that is started here.
        terminal = {signal.SIGINT, signal.SIGHUP}
        before = signal.pthread_sigmask(signal.SIG_BLOCK, terminal)
        try:
            return self._executor.submit(_call, function, item)
        except OSError as error:
            # Killed before it had read what it is to do: the pipe to it is broken.
            raise BrokenExecutor("a worker died while it was being started") from error
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def renew(self) -> None:
        """Begin again with living workers; what was submitted is forgotten."""
        self.abort()
        self._start()

    def close(self) -> None:
        """Let the workers go; they have nothing to do."""
        self._executor.shutdown()
        self._lifeline.close()

    def abort(self) -> None:
        """Interrupt what is running and let the workers go."""
        self._lifeline.close()
        self._executor.shutdown(cancel_futures=True)

    def _start(self) -> None:
        context = get_context("spawn")
        far_end, self._lifeline = context.Pipe(duplex=False)
        self._executor = ProcessPoolExecutor(
            self.workers, mp_context=context, initializer=_begin, initargs=(far_end,)
        )


def _begin(lifeline: Connection) -> None:
    """Prepare a worker process."""
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()
    signal.signal(signal.SIGTERM, _end)


def _end_with(lifeline: Connection) -> None:
    try:
        lifeline.recv_bytes()
    except (EOFError, OSError):
        os.kill(os.getpid(), signal.SIGTERM)


def _end(*_: object) -> NoReturn:
    # For code that never comes back to Python: SIGALRM ends the process.
    signal.alarm(_GRACE_S)
    # An exception, so that temporary files go away on the way up.
    raise SystemExit(1)


def _call(function: Callable[[Item], Result], item: Item) -> Result:
    try:
        return call_in_one_thread(function, item)
    except SystemExit:
        # An executor would send it back as the result of the item, and go on.
        os._exit(1)
