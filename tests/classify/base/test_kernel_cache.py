"""A kernel never runs code of another kernel or source, whatever became of the cache."""

import os
import subprocess
import sys
from itertools import product
from pathlib import Path

import pytest

from classify.base.compiling import _CodeFiles

# `scaled` is compiled for arrays that are contiguous, and for others.
PROGRAM = """
import resource, sys
import numpy as np
from classify.base.compiling import kernel

@kernel
def scaled(values):
    total = 0.0
    for k in range(len(values)):
        total += FACTOR * values[k]
    return total

if len(sys.argv) > 1:
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.RLIM_INFINITY))
values = np.arange(6.0)
print(scaled(values), scaled(values[::2]), *scaled.stats.cache_hits.values())
"""
FIRST = "15.0 6.0"


class Program:
    """A program with one kernel, in a folder of its own, which also holds the cache."""

    def __init__(self, folder: Path) -> None:
        self.path, self.cache = folder / "program.py", folder / "cache"
        self.write(1)

    def write(self, factor: int) -> None:
        self.path.write_text(PROGRAM.replace("FACTOR", f"{factor:.1f}"))

    def run(self, *arguments: str) -> str:
        variables = {"PYTHONPATH": os.pathsep.join(sys.path), "NUMBA_CACHE_DIR": str(self.cache)}
        done = subprocess.run(
            [sys.executable, self.path, *arguments],
            env=os.environ | variables, check=False, capture_output=True, text=True,
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout.strip()

    def files(self, suffix: str) -> list[Path]:
        return sorted(self.cache.rglob(f"program.scaled-*{suffix}"))


@pytest.fixture
def program(tmp_path: Path) -> Program:
    return Program(tmp_path)


def test_a_kernel_is_compiled_once_for_each_type(program: Program) -> None:
    assert program.run() == FIRST
    assert len(program.files(".nbc")) == 2
    assert program.run() == f"{FIRST} 1 1"


@pytest.mark.slow
def test_code_of_another_type_is_not_run(program: Program) -> None:
    """As when two programs compile at once, and each overwrites what the other has written."""
    program.run()
    one, other = program.files(".nbc")
    content = one.read_bytes(), other.read_bytes()
    one.write_bytes(content[1])
    other.write_bytes(content[0])
    assert program.run() == FIRST
    assert program.run() == f"{FIRST} 1 1"


@pytest.mark.slow
def test_code_of_an_older_source_is_neither_run_nor_kept(program: Program) -> None:
    program.run()
    old = program.files(".nbc")
    program.write(2)
    assert program.run() == "30.0 12.0"
    assert not any(path.exists() for path in old)
    assert len(program.files(".nbc")) == 2


@pytest.mark.slow
def test_files_that_were_not_written_to_the_end_are_written_again(program: Program) -> None:
    """As when the power goes."""
    program.run()
    for suffix, left in product((".nbi", ".nbc"), (0.0, 0.9)):
        for path in program.files(suffix):
            os.truncate(path, int(left * path.stat().st_size))
        assert program.run() == FIRST, (suffix, left)
        assert program.run() == f"{FIRST} 1 1", (suffix, left)


def test_code_that_another_program_removes_while_it_is_read_is_compiled_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = _CodeFiles(str(tmp_path), "kernel", "stamp")
    files.save("float32", "code")
    assert files.load("float32") == "code"
    read_bytes = Path.read_bytes

    def read_and_remove(path: Path) -> bytes:
        content = read_bytes(path)
        path.unlink()
        return content

    monkeypatch.setattr(Path, "read_bytes", read_and_remove)
    assert files.load("float32") is None


def test_a_full_disk_costs_the_cache_and_nothing_else(program: Program) -> None:
    assert program.run("1000") == FIRST
    assert program.files("") == []
