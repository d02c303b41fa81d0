"""Run checks in the guest, and report each as a test of the host."""

import ast
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence, Set
from pathlib import Path

import pytest

from .machine import EmulatorError, MachineError, run_in_guest

GUEST = Path(__file__).parent / "guest"
_ROOT = Path(__file__).parents[2]
# Four times what the longest file of checks takes on two idle cores.
_TIMEOUT_S = 1200.0
# Of one guest, if the emulator fails.
_BOOTS = 3

# The failure text of each case, as in ``test_it[cdc_acm]``; an empty text is a pass.
Outcomes = Mapping[str, str]


def names_in(source: Path) -> list[str]:
    """Names of all checks in a file, including imported ones."""
    names = []
    for node in ast.parse(source.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef):
            names.append(node.name)
        elif isinstance(node, ast.ImportFrom):
            names += [alias.name for alias in node.names]
    return [name for name in names if name.startswith("test_")]


def ps4rig(*arguments: object) -> list[str]:
    """The command that runs ps4rig in this environment."""
    return [sys.executable, "-m", "capture", *map(str, arguments)]


def compile_for_guest(shared: Path, *options: object) -> dict[str, str]:
    """Capture a set here; return the variables with which the guest uses the compiled kernels.

    They are compiled for any processor. The guest would take minutes to compile them.
    """
    compiled = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    here = os.environ | compiled | {"NUMBA_CACHE_DIR": str(shared / "numba")}
    command = ps4rig("capture", "--rig", "sim", *options, shared / "here.ome.tif")
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=here)
    assert done.returncode == 0, done.stderr
    return compiled | {"NUMBA_CACHE_DIR": "/mnt/numba"}


def run_checks(
    file: Path,
    shared: Path,
    *,
    modules: Mapping[str, str],
    devices: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
) -> Outcomes:
    """Boot a guest, run a file of checks there, and return the outcome of each.

    `environment` adds to that of the guest; for the other arguments see `run_in_guest`. A guest
    is booted again if the emulator failed. Without results, all checks fail.
    """
    variables = [f"{name}={value}" for name, value in (environment or {}).items()]
    # Plugins and the conftest.py of all tests would take the guest half a minute to import.
    pytest_there = [
        *("-m", "pytest", "-p", "no:cacheprovider", "--disable-plugin-autoload"),
        *(f"--confcutdir={file.parent}", "--color=no", "--tb=short"),
    ]
    checks = str(file.relative_to(_ROOT))
    command = [
        "env", *variables, sys.executable, *pytest_there, "--junitxml=/mnt/results.xml", checks,
    ]  # fmt: skip
    own_files = {*shared.rglob("*")}
    for boot in range(_BOOTS):
        try:
            console = run_in_guest(
                command, modules=modules, shared=shared, timeout_s=_TIMEOUT_S, devices=devices
            )
            break
        except MachineError as error:
            if not isinstance(error, EmulatorError) or boot == _BOOTS - 1:
                pytest.fail(str(error), pytrace=False)
            _remove_others(shared, own_files)
    results = shared / "results.xml"
    if not results.exists():
        pytest.fail(f"the guest's tests did not run:\n{console}", pytrace=False)
    return {
        case.attrib["name"]: "\n".join(f"{part.tag}: {part.text}" for part in case)
        for case in ET.parse(results).iter("testcase")
    }


def _remove_others(folder: Path, kept: Set[Path]) -> None:
    """Remove what a guest has written."""
    for path in sorted({*folder.rglob("*")} - kept, reverse=True):
        path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()


def assert_passed(outcomes: Outcomes, name: str) -> None:
    """Assert that a check ran and passed in all its cases; `name` may name one case."""
    cases = {case: text for case, text in outcomes.items() if name in (case, case.split("[")[0])}
    assert cases, f"{name} did not run in the guest"
    wrong = [f"{case}: {text}" for case, text in cases.items() if text]
    assert not wrong, "\n".join(wrong)
