"""Memory that is kept from frame to frame, and the number of threads."""

import json
import sys
from collections.abc import Callable
from typing import Any

import pytest

VARIABLES = ("MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_", "MALLOC_ARENA_MAX")
PROGRAM = """
import json, os, resource
from threading import Thread
{settle}
import numpy as np

def work():
    # Four maps of a frame of 512 x 512 px.
    for plane in [np.empty((512, 512), np.float32) for _ in range(4)]:
        plane.fill(1.0)

def frame():
    # Another thread each time, as frames are captured, solved and judged in several.
    thread = Thread(target=work)
    thread.start()
    thread.join()
    work()

frame()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(10):
    frame()
faults = resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
print(json.dumps([faults, [os.environ.get(name) for name in {variables}]]))
"""
SETTLE = "from capture.base.process_settings import configure_process; configure_process()"


@pytest.fixture
def outcome(run_python: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Count the page faults of ten frames; list the variables that child processes see."""
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)

    def run(settle: str = "", **changed: str) -> Any:
        program = PROGRAM.format(settle=settle, variables=VARIABLES)
        return json.loads(run_python(program, **changed))

    return run


@pytest.mark.skipif(sys.platform != "linux", reason="mallopt belongs to the GNU C library")
def test_the_memory_of_a_frame_is_used_for_the_next(outcome: Callable[..., Any]) -> None:
    assert outcome()[0] > 1000
    faults, variables = outcome(SETTLE)
    assert faults < 100
    assert variables == [str(256 * 2**20), str(32 * 2**20), "1"]


def test_variables_of_the_user_take_precedence(outcome: Callable[..., Any]) -> None:
    theirs = dict.fromkeys(VARIABLES, "131072")
    faults, variables = outcome(SETTLE, **theirs)
    assert variables == ["131072"] * 3
    if sys.platform == "linux":
        assert faults > 1000


THREADS = f"""
{SETTLE}
import os, sys
print(sys.getswitchinterval() < 0.001, os.environ["OPENBLAS_NUM_THREADS"])
"""


@pytest.mark.parametrize(("given", "used"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "2"}, "2")])
def test_threads_do_not_wait_long_for_one_another(
    run_python: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
    given: dict[str, str],
    used: str,
) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    assert run_python(THREADS, **given).split() == ["True", used]


@pytest.mark.parametrize("count", ["99999", "9" * 5000])
def test_too_many_threads_are_one_line(run_python: Callable[..., str], count: str) -> None:
    program = (
        "import classify.base.threads as t\n"
        "try: t.thread_count()\nexcept t.InputError as e: print(e)"
    )
    said = run_python(program, NUMBA_NUM_THREADS=count)
    (line,) = said.splitlines()
    assert line.startswith("NUMBA_NUM_THREADS is over 1024;")
