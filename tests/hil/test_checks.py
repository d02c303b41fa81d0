"""Checks in a guest are run again if it ends by a double fault, and only then."""

import re
from pathlib import Path
from typing import Any

import pytest

from . import checks
from .machine import MachineError

DOUBLE_FAULT = "traps: PANIC: double fault, error_code: 0x0\nKernel panic - not syncing"
RESULTS = "<testsuites><testsuite><testcase name='test_it'/></testsuite></testsuites>"


def guests(ends: list[str], seen: list[list[str]]) -> Any:
    """Guests that end with these texts, or with results for an empty one."""

    def run(*_: object, shared: Path, **__: object) -> str:
        seen.append(sorted(path.name for path in shared.rglob("*")))
        folder = shared / "session"
        folder.mkdir()
        (folder / "part.ome.tif").touch()
        if text := ends.pop(0):
            raise MachineError(text)
        (shared / "results.xml").write_text(RESULTS)
        return ""

    return run


def test_a_guest_that_ends_by_a_double_fault_is_booted_again_in_a_clean_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[list[str]] = []
    (tmp_path / "here.toml").touch()
    monkeypatch.setattr(checks, "run_in_guest", guests([DOUBLE_FAULT, ""], seen))
    outcomes = checks.run_checks(Path(checks.__file__), tmp_path, modules={})
    assert outcomes == {"test_it": ""}
    assert seen == [["here.toml"]] * 2


@pytest.mark.parametrize(
    ("ends", "boots"),
    [(["did not end in 1200 s"], 1), (["Kernel panic"], 1), ([DOUBLE_FAULT] * 3, 3)],
)
def test_other_ends_and_three_double_faults_are_failures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ends: list[str], boots: int
) -> None:
    seen: list[list[str]] = []
    said = re.escape(ends[-1])
    monkeypatch.setattr(checks, "run_in_guest", guests(ends, seen))
    with pytest.raises(pytest.fail.Exception, match=said):
        checks.run_checks(Path(checks.__file__), tmp_path, modules={})
    assert len(seen) == boots
