"""Unforeseen errors: exit status 70, one line, and a log file with the traceback."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture.base.process_end import report_crash

Spawn = Callable[..., Any]


@pytest.mark.parametrize("module", ["typer", "tifffile"])
@pytest.mark.parametrize("state_folder", ["state", "file/state"])
def test_an_unforeseen_error_is_status_70_and_names_a_log(
    spawn: Spawn, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, state_folder: str
) -> None:
    """If the state folder cannot be made, the log is in the temporary folder."""
    (tmp_path / f"{module}.py").write_text("raise ArithmeticError('two\\nlines')")
    (tmp_path / "file").touch()
    (tmp_path / "temporary").mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / state_folder))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    process = spawn("solve", "a.ome.tif", "--out", tmp_path / "maps")
    stdout, stderr = process.communicate(timeout=60)
    assert (process.returncode, stdout) == (70, "")
    line = "ps4rig: unforeseen error (ArithmeticError: two lines); the traceback is in "
    assert stderr.startswith(line)
    assert stderr.count("\n") == 1
    log = Path(stderr.removeprefix(line).strip())
    folder = {"state": "state/ps4rig", "file/state": "temporary"}[state_folder]
    assert log.parent == tmp_path / folder
    text = log.read_text()
    assert "Traceback" in text
    assert "a.ome.tif" in text


def test_logs_are_few_and_short(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    folder = tmp_path / "ps4rig"
    folder.mkdir()
    for number in range(30):
        (folder / f"ps4rig-crash-19990101T0000{number:02d}-x.log").touch()
    assert report_crash(ValueError("long " * 100_000)) == 70
    logs = sorted(folder.iterdir())
    assert len(logs) == 20
    assert 0 < logs[-1].stat().st_size < 100_000
    assert len(capsys.readouterr().err) < 500
