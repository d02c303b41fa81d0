"""Work is shared out completely, in order, and whatever the number of threads."""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial

import pytest

from classify.base.errors import InputError
from classify.base.threads import (
    Task,
    bound_to,
    in_background,
    map_in_threads,
    run_on_rows,
    set_thread_count,
    thread_count,
)


@pytest.fixture(autouse=True)
def default_thread_count() -> Iterator[None]:
    set_thread_count(None)
    yield
    set_thread_count(1)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_results_are_in_the_order_of_the_items(count: int) -> None:
    set_thread_count(count)
    assert map_in_threads(lambda item: item * item, range(100)) == [n * n for n in range(100)]


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (7, 10), (100, 3), (5, 1000)])
def test_strips_cover_each_row_once(count: int, rows: int, columns: int) -> None:
    set_thread_count(count)
    seen: list[tuple[int, int]] = []
    run_on_rows(lambda first, last: seen.append((first, last)), (rows, columns), strip_px=64)
    assert [row for strip in sorted(seen) for row in range(*strip)] == list(range(rows))


def test_all_threads_work_at_once() -> None:
    set_thread_count(3)
    meeting = threading.Barrier(3, timeout=60)
    map_in_threads(lambda _: meeting.wait(), range(3))


def test_a_call_within_a_call_ends() -> None:
    set_thread_count(2)

    def inner(item: int) -> int:
        return sum(map_in_threads(lambda other: item * other, range(4)))

    assert map_in_threads(inner, range(8)) == [6 * item for item in range(8)]


@pytest.mark.parametrize("count", [1, 2])
def test_work_beside_the_caller_has_its_result(count: int) -> None:
    set_thread_count(count)

    def work(item: int) -> int:
        nested = in_background(lambda: sum(map_in_threads(lambda other: item * other, range(4))))
        return nested()

    assert [each() for each in [in_background(partial(work, item)) for item in range(8)]] == [
        6 * item for item in range(8)
    ]


def test_work_goes_on_beside_the_caller() -> None:
    set_thread_count(2)
    meeting = threading.Barrier(2, timeout=60)
    other = in_background(meeting.wait)
    meeting.wait()
    other()


@pytest.mark.parametrize("count", [1, 4])
def test_an_exception_reaches_the_caller(count: int) -> None:
    set_thread_count(count)
    with pytest.raises(ZeroDivisionError):
        in_background(lambda: 1 // 0)()
    with pytest.raises(ZeroDivisionError):
        map_in_threads(lambda item: 1 // item, [3, 2, 1, 0, 1, 2, 3])


def test_a_thread_that_waits_does_short_tasks_meanwhile_and_no_long_ones() -> None:
    set_thread_count(2)
    began, release = threading.Event(), threading.Event()
    done: list[str] = []
    doers: list[int] = []

    def first() -> None:
        began.set()
        assert release.wait(60)
        done.append("first")

    def short() -> None:
        doers.append(threading.get_ident())
        done.append("short")
        release.set()

    of_first = in_background(first, is_long=True)
    assert began.wait(60)
    of_second = in_background(lambda: done.append("second"), is_long=True)
    in_background(short)
    of_first()
    of_second()
    assert doers == [threading.get_ident()]
    assert done == ["short", "first", "second"]


def test_work_that_nobody_has_begun_is_done_by_the_caller() -> None:
    set_thread_count(2)
    began, release = threading.Event(), threading.Event()

    def until_released() -> None:
        began.set()
        assert release.wait(60)

    busy = in_background(until_released)
    assert began.wait(60)
    mine = in_background(threading.get_ident)
    assert mine() == threading.get_ident()
    release.set()
    busy()


def test_an_interrupt_reaches_both_threads() -> None:
    """The one that asked for the work, and the one that did it and was interrupted."""

    def interrupted() -> None:
        raise KeyboardInterrupt

    task = Task(interrupted)
    with pytest.raises(KeyboardInterrupt):
        task.run()
    with pytest.raises(KeyboardInterrupt):
        task.future.result()


def test_a_process_ends_while_a_kept_thread_computes() -> None:
    code = """
from classify.base.threads import in_background, set_thread_count
import threading, time
set_thread_count(2)
began = threading.Event()
in_background(lambda: (began.set(), time.sleep(0.2), print("done", flush=True)))
began.wait()
"""
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert ended.stdout == "done\n"
    assert ended.stderr == ""


def test_a_processor_that_is_not_there_binds_nothing() -> None:
    before = os.sched_getaffinity(0)
    with bound_to(1_000_000):
        assert os.sched_getaffinity(0) == before
    assert os.sched_getaffinity(0) == before


def test_bound_threads_have_processors_of_their_own() -> None:
    code = """
import os, threading
from classify.base.threads import usable_processors
from classify.base.threads import on_free_processor, bind_workers, map_in_threads, thread_count
everywhere = os.sched_getaffinity(0)
with on_free_processor():
    assert os.sched_getaffinity(0) == everywhere
map_in_threads(str, range(2))  # kept threads that are not bound
bind_workers()
def of_all() -> list[set[int]]:
    meeting = threading.Barrier(thread_count(), timeout=60)
    def own(_: int) -> set[int]:
        meeting.wait()
        return os.sched_getaffinity(0)
    return map_in_threads(own, range(thread_count()))
def in_a_thread() -> None:
    with on_free_processor():
        assert sorted(map(tuple, of_all())) == [(each,) for each in sorted(everywhere)]
        assert usable_processors() == sorted(everywhere)
    assert os.sched_getaffinity(0) == everywhere
    found.append(True)
found = []
if len(everywhere) > 1:
    thread = threading.Thread(target=in_a_thread)
    thread.start()
    thread.join()
    assert found
bind_workers(is_bound=False)
with on_free_processor():
    assert os.sched_getaffinity(0) == everywhere
"""
    environment = {name: os.environ[name] for name in os.environ if name != "NUMBA_NUM_THREADS"}
    subprocess.run([sys.executable, "-c", code], env=environment, timeout=60, check=True)


def test_a_forked_process_has_threads_of_its_own() -> None:
    set_thread_count(2)
    map_in_threads(str, range(2))
    child = os.fork()
    if child == 0:
        meeting = threading.Barrier(2, timeout=60)
        map_in_threads(lambda _: meeting.wait(), range(2))
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0


def test_the_environment_sets_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    assert thread_count() == len(os.sched_getaffinity(0))
    monkeypatch.setenv("NUMBA_NUM_THREADS", "3")
    assert thread_count() == 3
    set_thread_count(1)
    assert thread_count() == 1


@pytest.mark.parametrize("text", ["0", "-1", "two", "1.5"])
def test_a_thread_count_below_1_is_an_input_error(
    text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", text)
    with pytest.raises(InputError, match=f"NUMBA_NUM_THREADS is '{text}'"):
        thread_count()
    with pytest.raises(InputError, match="0 threads"):
        set_thread_count(0)
