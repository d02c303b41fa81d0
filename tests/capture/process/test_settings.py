"""Threads that sleep and memory that is kept, in a process and in its children."""

import json
import os
import subprocess
import sys

import pytest

VARIABLES = ("GOMP_SPINCOUNT", "MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_")
OURS = (*VARIABLES, "OMP_WAIT_POLICY")
PROGRAM = """
import json, os, resource
{settle}
import numpy as np

def work():
    # Four maps of a frame of 512 x 512 px.
    for plane in [np.empty((512, 512), np.float32) for _ in range(4)]:
        plane.fill(1.0)

work()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(10):
    work()
faults = resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
print(json.dumps([faults, {{name: os.environ.get(name) for name in {variables}}}]))
"""
SETTLE = "from capture.process.settings import settle_process; settle_process()"


def outcome(settle: str = "", **variables: str) -> tuple[int, dict[str, str | None]]:
    """Page faults of ten frames, and the variables that children would see."""
    inherited = {
        name: value
        for name, value in os.environ.items()
        if name not in (*VARIABLES, "OMP_WAIT_POLICY")
    }
    program = PROGRAM.format(settle=settle, variables=VARIABLES)
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=inherited | {"PYTHONPATH": os.pathsep.join(sys.path)} | variables,
        capture_output=True,
        text=True,
        check=True,
    )
    faults, found = json.loads(done.stdout)
    return faults, found


@pytest.mark.skipif(sys.platform != "linux", reason="of the GNU C library")
def test_the_memory_of_a_frame_serves_the_next() -> None:
    assert outcome()[0] > 1000
    assert outcome(SETTLE)[0] < 100


def test_children_are_told_too() -> None:
    _, found = outcome(SETTLE)
    assert found == dict(zip(VARIABLES, ("10000", str(256 * 2**20), str(32 * 2**20)), strict=True))


def test_what_somebody_has_set_stays() -> None:
    theirs = dict(zip(VARIABLES, ("7", "131072", "131072"), strict=True))
    faults, found = outcome(SETTLE, **theirs)
    assert found == theirs
    assert outcome(SETTLE, OMP_WAIT_POLICY="ACTIVE")[1]["GOMP_SPINCOUNT"] is None
    if sys.platform == "linux":
        assert faults > 1000
