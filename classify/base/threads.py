"""Thread pool for kernels; its threads are kept between calls."""

import atexit
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, nullcontext, suppress
from typing import Any, Generic, TypeVar

from .errors import InputError


def usable_processors() -> list[int]:
    """Numbers of the processors this process may use; all if the system does not tell."""
    if hasattr(os, "sched_getaffinity"):
        # The affinity of the main thread (pid): other threads may be bound to one processor.
        return sorted(os.sched_getaffinity(os.getpid()))
    return list(range(os.cpu_count() or 1))


@contextmanager
def bound_to(processor: int) -> Iterator[None]:
    """Let this thread, and threads it starts, run on one processor, where that is possible."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    try:
        with suppress(OSError):
            os.sched_setaffinity(0, {processor})
        yield
    finally:
        with suppress(OSError):
            os.sched_setaffinity(0, before)


_Result = TypeVar("_Result")


class Task(Generic[_Result]):
    """A function that runs once, in the first thread that takes the task."""

    def __init__(self, work: Callable[[], _Result]) -> None:
        self._work = work
        self._ownership = threading.Lock()
        self.future: Future[_Result] = Future()

    def take(self) -> bool:
        """Reserve the task for this thread; False if another thread has taken it."""
        return self._ownership.acquire(blocking=False)

    def run(self) -> None:
        """Call the function unless the task is taken; its result or exception goes to `future`."""
        if not self.take():
            return
        try:
            self.future.set_result(self._work())
        except BaseException as error:
            self.future.set_exception(error)
            if not isinstance(error, Exception):
                raise  # KeyboardInterrupt must also end the thread in which it was raised


class _Workers:
    """Threads that run queued tasks in order, long ones first; thread n on `processors[n]`."""

    def __init__(self, count: int, processors: Sequence[int] = ()) -> None:
        self.count = count
        self._changed = threading.Condition()
        self._long: deque[Task[Any]] = deque()
        self._short: deque[Task[Any]] = deque()
        self._is_ending = False
        # The slice is empty for a thread that has no processor of its own.
        self._threads = [
            threading.Thread(
                target=self._serve, args=processors[n : n + 1], name=f"worker {n}", daemon=True
            )
            for n in range(count)
        ]
        for thread in self._threads:
            thread.start()

    def submit(self, work: Callable[[], _Result], *, is_long: bool = False) -> Task[_Result]:
        """Queue a function; threads that wait in `result_of` do not run it if it is long."""
        task = Task(work)
        with self._changed:
            if is_long:
                self._long.append(task)
                # Not notify(): it could wake a thread in `result_of`, which runs no long tasks.
                self._changed.notify_all()
            else:
                self._short.append(task)
                self._changed.notify()
        return task

    def result_of(self, task: Task[_Result]) -> _Result:
        """Return the result of a task, or raise its exception; run short tasks meanwhile."""
        task.run()
        future = task.future
        if not future.done():
            future.add_done_callback(lambda _: self._wake())
            while other := self._next(future.done, self._short):
                other.run()
        return future.result()

    def end(self) -> None:
        """Tell the threads to end after their present tasks; do not wait for them."""
        self._is_ending = True
        self._wake()

    def join(self) -> None:
        """Wait for the end of the threads."""
        for thread in self._threads:
            thread.join()

    def _serve(self, processor: int | None = None) -> None:
        with nullcontext() if processor is None else bound_to(processor):
            while task := self._next(lambda: self._is_ending, self._long, self._short):
                task.run()

    def _next(self, is_ended: Callable[[], bool], *queues: deque[Task[Any]]) -> Task[Any] | None:
        """Wait for the next task of the queues; None once `is_ended` is true."""
        with self._changed:
            while not is_ended():
                for queue in queues:
                    if queue:
                        return queue.popleft()
                self._changed.wait()
            # Pass on a notification for a task: this thread runs no more of them.
            self._changed.notify()
        return None

    def _wake(self) -> None:
        with self._changed:
            self._changed.notify_all()


_Item = TypeVar("_Item")

# Pixels of one strip of rows, about 200 us of work: much longer than the 10 us of a call, and short
# enough that threads end at about the same time.
STRIP_PX = 1 << 17

_MAX_THREADS = 1024  # more than processors of any machine, fewer than the system refuses

_count: int | None = None
_is_bound = False
_workers: _Workers | None = None
_lock = threading.Lock()


def thread_count() -> int:
    """Number of threads for kernels.

    It is that of `set_thread_count`, or else of NUMBA_NUM_THREADS, or else one per processor.
    """
    if _count is not None:
        return _count
    text = os.environ.get("NUMBA_NUM_THREADS", "").strip()
    if not text:
        return len(usable_processors())
    if not text.isdecimal() or not text.strip("0"):
        raise InputError(f"NUMBA_NUM_THREADS is {text!r}; give a whole number from 1, or unset it")
    digits = text.lstrip("0")
    if len(digits) > 9 or int(digits) > _MAX_THREADS:
        raise InputError(f"NUMBA_NUM_THREADS is over {_MAX_THREADS}; give that or fewer")
    return int(digits)


def set_thread_count(count: int | None) -> None:
    """Use `count` threads from now on in this process; None returns to the default."""
    global _count
    if count is not None and count < 1:
        raise InputError(f"{count} threads; give 1 or more")
    _count = count


def bind_workers(*, is_bound: bool = True) -> None:
    """Bind each worker thread to a processor of its own, or with False to none."""
    global _is_bound
    if is_bound != _is_bound:
        _is_bound = is_bound
        _end_workers()


@contextmanager
def on_free_processor() -> Iterator[None]:
    """Bind this thread, and threads it starts, to the processor that no bound worker uses."""
    if not _is_bound or thread_count() == 1:
        yield
        return
    with bound_to(usable_processors()[0]):
        yield


def map_in_threads(function: Callable[[_Item], _Result], items: Sequence[_Item]) -> list[_Result]:
    """`[function(item) for item in items]` in threads, including the calling one."""
    results: dict[int, _Result] = {}
    # One iterator for all threads: each takes the next item as soon as it is free.
    indices = iter(range(len(items)))

    def work() -> None:
        for index in indices:
            results[index] = function(items[index])

    helpers = min(thread_count(), len(items)) - 1
    tasks = [_shared_workers().submit(work) for _ in range(helpers)]
    try:
        work()
    finally:
        # All indices are given out: tasks that no thread has started are cancelled by `take`.
        errors = [task.future.exception() for task in tasks if not task.take()]
    for error in errors:
        if error is not None:
            raise error
    return [results[index] for index in range(len(items))]


def in_background(work: Callable[[], _Result], *, is_long: bool = False) -> Callable[[], _Result]:
    """Start `work` in another thread; return a function that waits for its result.

    Work that is not long must not wait for the result of another `in_background`.
    """
    # If no thread has started `work`, the waiting caller runs it; otherwise it runs other tasks
    # that are not long. If one of these waited, its result could be that of work which is suspended
    # further down the same stack: a deadlock.
    if thread_count() == 1:
        return work
    workers = _shared_workers()
    task = workers.submit(work, is_long=is_long)
    return lambda: workers.result_of(task)


def run_on_rows(
    function: Callable[[int, int], None], shape: tuple[int, int], strip_px: int = STRIP_PX
) -> None:
    """Call `function(first, last)` for strips of rows of `shape`, on any number of threads."""
    rows, columns = shape
    height = max(1, strip_px // max(columns, 1))
    strips = [(first, min(first + height, rows)) for first in range(0, rows, height)]
    if len(strips) == 1:
        function(0, rows)
    else:
        map_in_threads(lambda strip: function(*strip), strips)


def _shared_workers() -> _Workers:
    """The thread pool of this process; starting threads takes as long as a small frame."""
    global _workers
    count = thread_count() - 1
    with _lock:
        if _workers is None or _workers.count != count:
            if _workers is not None:
                _workers.end()
            _workers = _Workers(count, usable_processors()[1:] if _is_bound else ())
        return _workers


def _end_workers() -> _Workers | None:
    global _workers
    with _lock:
        workers, _workers = _workers, None
    if workers is not None:
        workers.end()
    return workers


@atexit.register
def _join_workers() -> None:
    """Join all threads: one that returns from compiled code after finalisation aborts Python."""
    workers = _end_workers()
    if workers is not None:
        workers.join()


def _forget_workers() -> None:
    global _workers, _lock
    _workers, _lock = None, threading.Lock()


if hasattr(os, "register_at_fork"):
    # The threads of a process do not run in its forked children.
    os.register_at_fork(after_in_child=_forget_workers)
