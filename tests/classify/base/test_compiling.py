"""Kernels are cached where a folder can be written to, and work without a cache."""

import ast
import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core import config as numba_config

import classify
from classify.base import compiling

PROGRAM = """
import numpy as np
from classify import Lighting, photometric_stereo
from classify.base.compiling import kernel_cache_folder

lighting = Lighting.ring(45.0)
images = np.full((4, 8, 8), 100, np.uint8)
assert photometric_stereo(images, lighting, "ps4").valid.all()
print(kernel_cache_folder())
"""


def run(program: str = PROGRAM, **variables: str) -> str:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)} | variables
    command = [sys.executable, "-c", program]
    done = subprocess.run(
        command, env=environment, cwd="/", check=False, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.strip()


@pytest.mark.slow
def test_kernels_are_cached_in_the_folder_of_the_environment(tmp_path: Path) -> None:
    folder = Path(run(NUMBA_CACHE_DIR=str(tmp_path)))
    assert folder.parent == tmp_path
    assert list(tmp_path.rglob("ps4.*.nbc"))


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["/dev/null/cache", "/proc/cache"])
def test_kernels_run_without_a_cache_where_no_folder_can_be_written(folder: str) -> None:
    only = {"NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator"}
    assert run(NUMBA_CACHE_DIR=folder, **only) == "None"


def test_a_cache_folder_that_cannot_be_written_is_replaced_by_another() -> None:
    assert Path(run(NUMBA_CACHE_DIR="/dev/null/cache")).is_dir()


def test_constants_of_kernels_come_from_files_whose_change_compiles_anew() -> None:
    """A constant of another file would stay as it was in the cached machine code."""
    package = Path(classify.__file__).parent
    digested = {path for path in package.rglob("*.py") if "@kernel" in path.read_text()}
    digested |= {package / "shadow_rule.py", package / "base" / "compiling.py"}
    for path in digested:
        body = ast.parse(path.read_text()).body
        sources = {
            name.asname or name.name: source(path, node)
            for node in body
            if isinstance(node, ast.ImportFrom) and (node.level or node.module[:8] == "classify")
            for name in node.names
        }
        for function in body:
            if isinstance(function, ast.FunctionDef) and is_kernel(function):
                for node in ast.walk(ast.Module(function.body, [])):
                    name = getattr(node, "id", None)
                    assert sources.get(name, path) in digested, f"{name} in {path}"


def is_kernel(function: ast.FunctionDef) -> bool:
    return any(getattr(each, "id", "").startswith("kernel") for each in function.decorator_list)


def source(path: Path, node: ast.ImportFrom) -> Path:
    root = path.parents[node.level - 1] if node.level else Path(classify.__file__).parents[1]
    module = root.joinpath(*(node.module or "").split("."))
    return module / "__init__.py" if module.is_dir() else module.with_suffix(".py")


@pytest.mark.slow
def test_a_change_in_another_file_of_kernels_compiles_anew(tmp_path: Path) -> None:
    """Kernels of other files are compiled into a kernel, for example `judge_row`."""
    package = tmp_path / "classify"
    shutil.copytree(Path(classify.__file__).parent, package, ignore=shutil.ignore_patterns("__py*"))
    variables = {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    program = PROGRAM.replace('"ps4"', '"least_squares"')
    run(program, **variables)
    # The limit is beyond every normal, so that no pixel is valid.
    rule = package / "shadow_rule.py"
    limit = "MIN_NORMAL_Z = np.float32(0.02)"
    assert limit in rule.read_text()
    rule.write_text(rule.read_text().replace(limit, "MIN_NORMAL_Z = np.float32(2.0)"))
    run(program.replace("valid.all()", "valid.any() == False"), **variables)


def test_an_empty_cache_says_once_that_kernels_are_compiled(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, compiling.__name__)
    # Numba reads its variables anew, also this one, when it compiles after a test changed one.
    numba_config.reload_config()
    monkeypatch.setattr(numba_config, "CACHE_DIR", str(tmp_path))
    compiling._announce_compilation.cache_clear()
    for function in (_one, _two):
        compiling.kernel(function)()
    (record,) = caplog.records
    assert str(tmp_path) in record.getMessage()


def _one() -> int:
    return 1


def _two() -> int:
    return 2
