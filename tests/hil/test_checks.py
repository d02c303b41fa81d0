"""Checks in a guest are run again if the emulator fails, and only then."""

import re
from pathlib import Path
from typing import Any

import pytest

from . import checks
from .machine import EmulatorError, MachineError, run_in_guest

BROKEN = EmulatorError("the guest was silent for 180 s")
RESULTS = "<testsuites><testsuite><testcase name='test_it'/></testsuite></testsuites>"


def guests(ends: list[MachineError | None], seen: list[list[str]]) -> Any:
    """Guests that end with these errors, or with results for None."""

    def run(*_: object, shared: Path, **__: object) -> str:
        seen.append(sorted(path.name for path in shared.rglob("*")))
        folder = shared / "session"
        folder.mkdir()
        (folder / "part.ome.tif").touch()
        if error := ends.pop(0):
            raise error
        (shared / "results.xml").write_text(RESULTS)
        return ""

    return run


def test_a_guest_whose_emulator_fails_is_booted_again_in_a_clean_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[list[str]] = []
    (tmp_path / "here.toml").touch()
    monkeypatch.setattr(checks, "run_in_guest", guests([BROKEN, None], seen))
    outcomes = checks.run_checks(Path(checks.__file__), tmp_path, modules={})
    assert outcomes == {"test_it": ""}
    assert seen == [["here.toml"]] * 2


@pytest.mark.parametrize(
    ("ends", "boots"),
    [([MachineError("1200 s")], 1), ([BROKEN] * 3, 3)],
)
def test_other_ends_and_three_failures_of_the_emulator_are_failures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ends: list[MachineError | None], boots: int
) -> None:
    seen: list[list[str]] = []
    said = re.escape(str(ends[-1]))
    monkeypatch.setattr(checks, "run_in_guest", guests(ends, seen))
    with pytest.raises(pytest.fail.Exception, match=said):
        checks.run_checks(Path(checks.__file__), tmp_path, modules={})
    assert len(seen) == boots


@pytest.mark.kernel
def test_a_guest_that_stops_is_told_from_one_that_takes_too_long(tmp_path: Path) -> None:
    stopped, slow = tmp_path / "stopped", tmp_path / "slow"
    for folder in (stopped, slow):
        folder.mkdir()
    with pytest.raises(EmulatorError, match="silent for 3 s"):
        run_in_guest(
            ["true"], modules={}, shared=stopped, timeout_s=60.0, devices=["-S"], silence_s=3.0
        )
    with pytest.raises(MachineError, match=r"in 75 s:\n.*it is up") as caught:
        run_in_guest(
            ["sh", "-c", "echo it is up; sleep 600"], modules={}, shared=slow, timeout_s=75.0,
            silence_s=60.0,
        )  # fmt: skip
    assert not isinstance(caught.value, EmulatorError)
    assert (slow / "beat").exists()


@pytest.mark.kernel
def test_a_double_fault_is_of_the_emulator_and_another_end_is_not(tmp_path: Path) -> None:
    for name, said, kind in (
        ("fault", "traps: PANIC: double fault, error_code: 0x0", EmulatorError),
        ("other", "Kernel panic - not syncing", MachineError),
    ):
        (tmp_path / name).mkdir()
        with pytest.raises(MachineError, match=re.escape(said)) as caught:
            run_in_guest(
                ["sh", "-c", f"echo '{said}'; busybox poweroff -f"], modules={},
                shared=tmp_path / name, timeout_s=300.0,
            )  # fmt: skip
        assert type(caught.value) is kind
