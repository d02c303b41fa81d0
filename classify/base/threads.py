"""Share out work among threads that are kept from call to call."""

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
    """Numbers of the processors that this process may use; all where that is unknown."""
    if hasattr(os, "sched_getaffinity"):
        # Of the main thread: others may be bound to one processor.
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
    """Work that one thread does, whichever takes it first."""

    def __init__(self, work: Callable[[], _Result]) -> None:
        self._work = work
        self._free = threading.Lock()
        self.future: Future[_Result] = Future()

    def take(self) -> bool:
        """Take the task away from all other threads; False if it is taken already."""
        return self._free.acquire(blocking=False)

    def run(self) -> None:
        """Do the work, if it is not taken; the future has its result, or its exception."""
        if not self.take():
            return
        try:
            self.future.set_result(self._work())
        except BaseException as error:
            self.future.set_exception(error)
            if not isinstance(error, Exception):
                raise  # Ctrl-C is for the thread that it interrupts, too


class Workers:
    """Threads that do tasks in the order of a queue, long ones first, bound to `processors`.

    Give one fewer than may compute: a thread that waits for a result does other tasks meanwhile.
    """

    def __init__(self, count: int, processors: Sequence[int] = ()) -> None:
        self.count = count
        self._changed = threading.Condition()
        self._long: deque[Task[Any]] = deque()
        self._short: deque[Task[Any]] = deque()
        self._is_ending = False
        self._threads = [
            threading.Thread(
                target=self._serve, args=processors[n : n + 1], name=f"worker {n}", daemon=True
            )
            for n in range(count)
        ]
        for thread in self._threads:
            thread.start()

    def submit(self, work: Callable[[], _Result], *, is_long: bool = False) -> Task[_Result]:
        """Queue work; a thread that waits for a result takes it only if it is not long."""
        task = Task(work)
        with self._changed:
            if is_long:
                self._long.append(task)
                self._changed.notify_all()
            else:
                self._short.append(task)
                self._changed.notify()
        return task

    def result_of(self, task: Task[_Result]) -> _Result:
        """Return the result of a task, or raise its exception; do other tasks meanwhile."""
        task.run()
        future = task.future
        if not future.done():
            future.add_done_callback(lambda _: self._wake())
            while other := self._next(future.done, self._short):
                other.run()
        return future.result()

    def end(self) -> None:
        """Let the threads end after the tasks that they do; return at once."""
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
            # It may have been woken for a task that it does not take.
            self._changed.notify()
        return None

    def _wake(self) -> None:
        with self._changed:
            self._changed.notify_all()


_Item = TypeVar("_Item")

# Pixels of one strip of rows: 200 us of work, which is long for the 10 us of a call and short
# enough that threads end at about the same time.
STRIP_PX = 1 << 17

_MOST_THREADS = 1024  # more than any machine has processors, and fewer than the system refuses

_count: int | None = None
_is_bound = False
_workers: Workers | None = None
_lock = threading.Lock()


def thread_count() -> int:
    """Threads for kernels: `set_thread_count`, `NUMBA_NUM_THREADS`, or one per processor."""
    if _count is not None:
        return _count
    text = os.environ.get("NUMBA_NUM_THREADS", "").strip()
    if not text:
        return len(usable_processors())
    if not text.isdecimal() or not text.strip("0"):
        raise InputError(f"NUMBA_NUM_THREADS is {text!r}; give a whole number from 1, or unset it")
    digits = text.lstrip("0")
    if len(digits) > 9 or int(digits) > _MOST_THREADS:
        raise InputError(f"NUMBA_NUM_THREADS is over {_MOST_THREADS}; give that or fewer")
    return int(digits)


def set_thread_count(count: int | None) -> None:
    """Use `count` threads from now on in this process; None returns to the default."""
    global _count
    if count is not None and count < 1:
        raise InputError(f"{count} threads; give 1 or more")
    _count = count


def bind_workers(*, is_bound: bool = True) -> None:
    """Bind each kept thread of this process to a processor of its own from now on."""
    global _is_bound
    if is_bound != _is_bound:
        _is_bound = is_bound
        _end_workers()


@contextmanager
def beside_workers() -> Iterator[None]:
    """Bind the calling thread, and those it starts, to the processor `bind_workers` leaves."""
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
    tasks = [_kept_workers().submit(work) for _ in range(helpers)]
    try:
        work()
    finally:
        # Threads that have not started by now have nothing left to do.
        errors = [task.future.exception() for task in tasks if not task.take()]
    for error in errors:
        if error is not None:
            raise error
    return [results[index] for index in range(len(items))]


def beside(work: Callable[[], _Result], *, is_long: bool = False) -> Callable[[], _Result]:
    """Start work in another thread; return a function that waits for its result.

    A waiting caller does the work itself or helps others, with tasks that are not `is_long`; short
    work must not wait for other work started by `beside`, which may lie below it on the same stack.
    """
    if thread_count() == 1:
        return work
    workers = _kept_workers()
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


def _kept_workers() -> Workers:
    """Threads kept between calls: starting new ones takes as long as a small frame."""
    global _workers
    count = thread_count() - 1
    with _lock:
        if _workers is None or _workers.count != count:
            if _workers is not None:
                _workers.end()
            _workers = Workers(count, usable_processors()[1:] if _is_bound else ())
        return _workers


def _end_workers() -> Workers | None:
    global _workers
    with _lock:
        workers, _workers = _workers, None
    if workers is not None:
        workers.end()
    return workers


@atexit.register
def _join_workers() -> None:
    """Wait for all threads: one that leaves compiled code after the end aborts Python."""
    workers = _end_workers()
    if workers is not None:
        workers.join()


def _forget_workers() -> None:
    global _workers, _lock
    _workers, _lock = None, threading.Lock()


if hasattr(os, "register_at_fork"):
    # The threads of a process do not run in its forked children.
    os.register_at_fork(after_in_child=_forget_workers)
