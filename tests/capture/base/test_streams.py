"""Readers that go away, closed streams and narrow encodings."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Spawn = Callable[..., Any]
CAPTURE = ("capture", "--rig", "sim", "--size", 64)


def outcome(process: Any) -> tuple[int, str | None, str]:
    stdout, stderr = process.communicate(timeout=60)
    return process.returncode, stdout, stderr


@pytest.mark.slow
def test_a_reader_that_goes_away_does_not_stop_the_work(spawn: Spawn, tmp_path: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    process = spawn(*CAPTURE, "--count", 3, tmp_path / "a.ome.tif", stdout=writing)
    os.close(writing)
    assert outcome(process) == (141, None, "")
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.slow
def test_output_that_cannot_be_written_is_one_line_after_the_work(
    spawn: Spawn, tmp_path: Path
) -> None:
    with Path("/dev/full").open("w") as full:
        process = spawn(*CAPTURE, tmp_path / "a.ome.tif", stdout=full)
    line = "ps4rig: standard output: No space left on device\n"
    assert outcome(process) == (2, None, line)
    assert (tmp_path / "a.ome.tif").is_file()


@pytest.mark.slow
def test_a_closed_output_is_discarded(spawn: Spawn, tmp_path: Path) -> None:
    path = tmp_path / "a.ome.tif"
    process = spawn(*CAPTURE, path, preexec_fn=lambda: os.close(1))
    assert outcome(process) == (0, "", "")
    assert path.is_file()


@pytest.mark.parametrize(
    "arguments",
    [("capture", "--rig", "none.toml", "a.ome.tif"), ("capture", "--none"), ("no-such-command",)],
)
def test_an_error_never_goes_to_standard_output(spawn: Spawn, arguments: tuple[str, ...]) -> None:
    assert outcome(spawn(*arguments, preexec_fn=lambda: os.close(2))) == (2, "", "")


@pytest.mark.slow
def test_characters_that_the_encoding_lacks_are_escaped(
    spawn: Spawn, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    status, stdout, stderr = outcome(spawn(*CAPTURE, "größe.ome.tif"))
    assert (status, stderr) == (0, "")
    assert stdout is not None
    assert stdout.startswith(r"gr\xf6\xdfe.ome.tif: 4 lights")
    assert outcome(spawn("solve", "ä", "--out", "b")) == (
        2, "", "ps4rig: \\xe4: no such file or folder\n",
    )  # fmt: skip


def test_an_argument_that_is_not_utf_8_is_one_line(spawn: Spawn) -> None:
    assert outcome(spawn("solve", "\udcff.ome.tif", "--out", "a")) == (
        2, "",
        "ps4rig: argument \\udcff.ome.tif: not valid UTF-8; use another text, or rename the file\n",
    )  # fmt: skip


def test_a_closed_input_is_empty(run_python: Callable[..., str]) -> None:
    program = (
        "import os, sys\nfrom capture.base.process_end import StandardStreams\n"
        "StandardStreams()\nprint(repr(sys.stdin.readline()), sys.stdin.isatty())\n"
        "print(os.read(sys.stdin.fileno(), 9))"
    )
    shell = ("sh", "-c", 'exec "$@" <&-', "sh")
    assert run_python(program, before=shell) == "'' False\nb''\n"


@pytest.mark.parametrize("columns", ["0", ""])
def test_a_terminal_without_a_width_shows_the_output(
    spawn: Spawn, monkeypatch: pytest.MonkeyPatch, columns: str
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    status, stdout, stderr = outcome(spawn("--help"))
    assert (status, stderr) == (0, "")
    assert stdout is not None
    assert "classify" in stdout
