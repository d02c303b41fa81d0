"""The start of the command: what it loads for a page of help, and Ctrl-C before it has loaded."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import capture
import classify
import rig

HELP = """
import sys
from typer.testing import CliRunner
from capture.cli import app
pages = [[], *([name] for name in sys.argv[1:])]
assert all(CliRunner().invoke(app, [*page, "--help"]).exit_code == 0 for page in pages)
print(*{name.split(".")[0] for name in sys.modules})
"""
# Not pydantic: typer has it for itself.
HEAVY = {"cv2", "distributed", "matplotlib", "numba", "numpy", "scipy", "serial", "tifffile"}


def test_help_loads_nothing_that_takes_its_time() -> None:
    names = ("demo", "capture", "import", "solve", "train", "classify", "evaluate")
    result = subprocess.run(
        [sys.executable, "-c", HELP, *names],
        check=True,
        capture_output=True,
        text=True,
        env={"PYTHONPATH": ":".join(sys.path)},
    )
    loaded = set(result.stdout.split())
    assert {"typer", "capture", "classify"} <= loaded
    assert loaded & HEAVY == set()


@pytest.mark.parametrize("package", [capture, classify, rig])
def test_every_public_name_is_there_when_it_is_asked_for(package: Any) -> None:
    assert package.__all__
    for name in package.__all__:
        assert getattr(package, name) is not None
    with pytest.raises(AttributeError):
        _ = package.no_such_name


@pytest.mark.parametrize("module", ["typer", "numba"])
def test_ctrl_c_in_an_import_is_one_line(
    spawn: Callable[..., Any],
    sets: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    module: str,
) -> None:
    (tmp_path / f"{module}.py").write_text("import signal; signal.raise_signal(signal.SIGINT)")
    monkeypatch.syspath_prepend(tmp_path)
    process = spawn("solve", sets / "rock-001.ome.tif", "--out", tmp_path / "maps")
    stdout, stderr = process.communicate(timeout=30)
    assert (process.returncode, stdout, stderr) == (130, "", "ps4rig: interrupted\n")
    assert not (tmp_path / "maps").exists()
