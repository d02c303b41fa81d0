"""Files are written whole or not at all."""

import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from classify import InputError
from classify.durable_file import durable_file


def names(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


def test_the_file_appears_when_the_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "set.ome.tif"
    with durable_file(path) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".tif"
        assert temporary.name.startswith(".")
        temporary.write_text("new")
        assert not path.exists()
    assert path.read_text() == "new"
    assert names(tmp_path) == [path.name]


def test_data_are_synced_before_the_rename_and_the_folder_after_it(
    tmp_path: Path, monkeypatch
) -> None:
    path = tmp_path / "a.txt"
    synced: list[tuple[str, bool]] = []
    really_sync = os.fsync

    def sync(descriptor: int) -> None:
        kind = "folder" if stat.S_ISDIR(os.fstat(descriptor).st_mode) else "file"
        synced.append((kind, path.exists()))
        really_sync(descriptor)

    monkeypatch.setattr(os, "fsync", sync)
    with durable_file(path) as temporary:
        temporary.write_text("new")
    assert synced == [("file", False), ("folder", True)]


def test_an_older_file_is_replaced_in_one_step(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with durable_file(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt, SystemExit])
def test_an_exception_in_the_block_is_raised_and_the_old_file_stays(
    tmp_path: Path, failure: type[BaseException]
) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(failure), durable_file(path) as temporary:  # noqa: PT012
        temporary.write_text("half")
        raise failure
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]


def test_a_disk_error_in_the_block_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with pytest.raises(InputError, match="No space left on device") as caught:  # noqa: SIM117
        with durable_file(path), Path("/dev/full").open("wb", buffering=0) as full:
            full.write(b"x")
    assert str(caught.value) == f"{path}: cannot be written: No space left on device"
    assert names(tmp_path) == []


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    path = tmp_path / "none" / "a.txt"
    with pytest.raises(InputError, match="No such file or directory") as caught:  # noqa: SIM117
        with durable_file(path):
            pytest.fail("the block must not begin")
    assert str(path) in str(caught.value)


def test_a_folder_in_the_place_of_the_file_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.mkdir()
    with pytest.raises(InputError, match="Is a directory"), durable_file(path) as temporary:
        temporary.write_text("new")
    assert path.is_dir()
    assert names(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("path", [".", "", ".."])
def test_a_path_that_names_no_file_is_refused(tmp_path: Path, monkeypatch, path: str) -> None:
    (tmp_path / "inner").mkdir()
    monkeypatch.chdir(tmp_path / "inner")
    with (
        pytest.raises(InputError, match="cannot be written"),
        durable_file(Path(path)) as temporary,
    ):
        temporary.write_text("new")
    assert names(tmp_path) == ["inner"]
    assert names(tmp_path / "inner") == []


def test_a_file_in_the_place_of_the_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("file")
    with pytest.raises(InputError, match="Not a directory"), durable_file(tmp_path / "a" / "b"):
        pytest.fail("the block must not begin")


def test_a_folder_without_permission_is_named() -> None:
    """/proc refuses new files even for root."""
    assert sys.platform == "linux"
    with pytest.raises(InputError, match="cannot be written"), durable_file(Path("/proc/x.txt")):
        pytest.fail("the block must not begin")


@pytest.mark.parametrize("mask", [0o022, 0o077])
def test_the_new_file_has_the_permissions_of_any_new_file(tmp_path: Path, mask: int) -> None:
    before = os.umask(mask)
    try:
        with durable_file(tmp_path / "a.txt") as temporary:
            temporary.write_text("new")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o666 & ~mask


def test_the_permission_mask_of_the_process_is_never_touched(tmp_path, monkeypatch) -> None:
    """A umask of zero for an instant would affect files that other threads create."""
    masks: list[int] = []
    monkeypatch.setattr(os, "umask", lambda mask: masks.append(mask) or 0o022)
    with durable_file(tmp_path / "a.txt") as temporary:
        temporary.write_text("new")
    assert masks == []


def test_many_writers_of_one_file_leave_one_whole_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"

    def write(letter: str) -> None:
        with durable_file(path) as temporary:
            temporary.write_text(letter * 10_000)

    threads = [threading.Thread(target=write, args=(letter,)) for letter in "abcdefgh"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    text = path.read_text()
    assert len(text) == 10_000
    assert len(set(text)) == 1
    assert names(tmp_path) == ["a.txt"]


def test_a_link_is_followed_and_stays_a_link(tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    link = tmp_path / "a.txt"
    link.symlink_to("shared/b.txt")
    for text in ("new", "newer"):  # the target is missing at first
        with durable_file(link) as temporary:
            assert temporary.parent == shared
            temporary.write_text(text)
        assert (shared / "b.txt").read_text() == text
        assert link.is_symlink()
    assert names(shared) == ["b.txt"]


def test_a_link_to_itself_is_an_input_error(tmp_path: Path) -> None:
    link = tmp_path / "a.txt"
    link.symlink_to(link)
    with pytest.raises(InputError, match="cannot be written"), durable_file(link):
        pytest.fail("the block must not begin")


@pytest.mark.parametrize("through_link", [False, True])
def test_a_device_or_pipe_is_not_replaced(tmp_path: Path, through_link: bool) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    path = tmp_path / "link" if through_link else pipe
    if through_link:
        path.symlink_to(pipe)
    with pytest.raises(InputError, match="not a regular file"), durable_file(path):
        pytest.fail("the block must not begin")
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_the_file_of_a_killed_writer_is_removed_by_the_next(tmp_path: Path) -> None:
    program = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from classify.durable_file import durable_file\n"
        "with durable_file(Path(sys.argv[1])) as temporary:\n"
        "    temporary.write_text('half')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    path = tmp_path / "a.tif"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", program, path], env=environment, check=False)
    assert len(names(tmp_path)) == 1
    with durable_file(path) as temporary:
        temporary.write_text("new")
        assert names(tmp_path) == [temporary.name]
    assert names(tmp_path) == ["a.tif"]


def test_the_file_of_a_writer_at_work_stays(tmp_path: Path) -> None:
    with durable_file(tmp_path / "a.txt") as slow:
        slow.write_text("slow")
        with durable_file(tmp_path / "b.txt") as quick:
            quick.write_text("quick")
        assert slow.exists()
    assert sorted(names(tmp_path)) == ["a.txt", "b.txt"]
