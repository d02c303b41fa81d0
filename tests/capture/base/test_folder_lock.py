"""The lock on a folder, with the locks of POSIX and without them."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from capture.base.folder_lock import folder_lock
from classify.base.errors import InputError

HOLD = """
import sys
from pathlib import Path
{block}
from capture.base.folder_lock import folder_lock
with folder_lock(Path(sys.argv[1]), "owner.lock"):
    print("held", flush=True)
    sys.stdin.readline()
"""
HOLDERS = [HOLD.format(block=""), HOLD.format(block='sys.modules["fcntl"] = None')]


@pytest.mark.parametrize("program", HOLDERS, ids=["with fcntl", "without fcntl"])
def test_a_folder_is_for_one_program_until_it_ends_or_is_killed(
    program: str, tmp_path: Path
) -> None:
    command = [sys.executable, "-c", program, str(tmp_path)]

    def second() -> subprocess.CompletedProcess[str]:
        return subprocess.run(command, input="\n", capture_output=True, text=True, timeout=60.0)

    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as first:
        assert first.stdout is not None
        assert first.stdout.readline() == "held\n"
        assert f"ps4rig, process {first.pid} since" in second().stderr
        (tmp_path / "owner.lock").unlink()  # it only names the owner
        assert "by another program" in second().stderr
        first.kill()
        first.wait()
    assert second().stdout == "held\n"
    assert second().stdout == "held\n"
    assert not (tmp_path / "owner.lock").exists()


@pytest.mark.parametrize("program", HOLDERS, ids=["with fcntl", "without fcntl"])
def test_a_folder_that_cannot_be_locked_is_named(program: str, tmp_path: Path) -> None:
    command = [sys.executable, "-c", program, str(tmp_path / "none")]
    refused = subprocess.run(command, capture_output=True, text=True, timeout=60.0)
    assert "InputError" in refused.stderr
    assert "none: cannot be locked: " in refused.stderr


def test_a_file_system_without_locks_is_named_with_the_way_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fcntl = pytest.importorskip("fcntl")

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", refuse)
    with (
        pytest.raises(InputError, match=r"No locks available; .* a folder on a local disk"),
        folder_lock(tmp_path, "owner.lock"),
    ):
        pass


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("program", HOLDERS, ids=["with fcntl", "without fcntl"])
def test_a_full_disk_is_named_with_the_file(program: str, tmp_path: Path) -> None:
    (tmp_path / "owner.lock").symlink_to("/dev/full")
    command = [sys.executable, "-c", program, str(tmp_path)]
    refused = subprocess.run(command, capture_output=True, text=True, timeout=60.0)
    assert "owner.lock: cannot be written" in refused.stderr
