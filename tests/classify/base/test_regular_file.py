"""Reading input files: regular files of bounded size."""

import os
import tracemalloc
from pathlib import Path

import pytest

from classify.base.errors import InputError
from classify.base.regular_file import read_regular_file


def test_a_file_and_a_link_to_it_are_read_up_to_the_limit(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"12345")
    (tmp_path / "link").symlink_to("a")
    assert read_regular_file(tmp_path / "link", 5) == b"12345"
    with pytest.raises(InputError, match="a: larger than 4 bytes"):
        read_regular_file(tmp_path / "a", 4)


@pytest.mark.parametrize("target", ["/dev/zero", "/dev/tty", "pipe", "folder", "a\0b", "\ud800"])
def test_pipes_devices_and_invalid_names_are_refused_at_once(tmp_path: Path, target: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    places = [tmp_path / target]
    if target.startswith("/dev"):
        (tmp_path / "link").symlink_to(target)
        places.append(tmp_path / "link")
    for place in places:
        with pytest.raises(InputError, match=r"cannot be read|file name"):
            read_regular_file(place, 100)


def test_a_file_that_states_no_size_is_bounded_by_what_was_read() -> None:
    assert Path("/proc/self/status").stat().st_size == 0
    with pytest.raises(InputError, match="larger than 10 bytes"):
        read_regular_file(Path("/proc/self/status"), 10)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none: no such file"):
        read_regular_file(tmp_path / "none", 1)


def test_a_small_file_takes_little_memory_whatever_its_limit(tmp_path: Path) -> None:
    path = tmp_path / "journal.json"
    content = bytes(range(256)) * 10_000  # more than one piece
    path.write_bytes(content)
    tracemalloc.start()
    try:
        assert read_regular_file(path, 1 << 30) == content
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 4 * len(content)
