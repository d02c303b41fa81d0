"""`Workers`: kept threads, helped by every thread that waits, and the processors for them."""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, nullcontext, suppress
from typing import Any, Generic, TypeVar


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


Result = TypeVar("Result")


class Task(Generic[Result]):
    """Work that one thread does, whichever takes it first."""

    def __init__(self, work: Callable[[], Result]) -> None:
        self._work = work
        self._free = threading.Lock()
        self.future: Future[Result] = Future()

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

    def submit(self, work: Callable[[], Result], *, is_long: bool = False) -> Task[Result]:
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

    def result_of(self, task: Task[Result]) -> Result:
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
