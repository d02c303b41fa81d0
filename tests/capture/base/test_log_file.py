"""Lines appended to log files."""

import os
import threading
from pathlib import Path

import pytest

from capture.base.outputs import append_line
from classify import InputError


def test_lines_are_appended(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    for line in ("one", "two é"):
        append_line(path, line)
    assert path.read_text(encoding="utf-8") == "one\ntwo é\n"


def test_a_pipe_with_a_reader_gets_every_line(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.log"
    os.mkfifo(pipe)
    read: list[str] = []
    reader = threading.Thread(target=lambda: read.extend(pipe.read_text().splitlines()))
    reader.start()
    with pipe.open("w"):  # the reader ends with the last writer
        for number in range(200):
            append_line(pipe, f"{number} " + 1000 * "x")
    reader.join()
    assert [line.split()[0] for line in read] == [str(number) for number in range(200)]


def test_what_may_block_or_cannot_be_written_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.log")
    for name in ("pipe.log", "none/a.log"):
        with pytest.raises(InputError, match=rf"{name}: cannot be written: "):
            append_line(tmp_path / name, "line")
