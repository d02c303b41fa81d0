"""Files are written whole or not at all."""

import errno
import os
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from classify import InputError
from classify.base.durable_file import durable_file, write_text


def names(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


@pytest.mark.parametrize("old", [None, "old"])
def test_the_file_appears_or_is_replaced_when_the_block_ends(
    tmp_path: Path, old: str | None
) -> None:
    path = tmp_path / "set.ome.tif"
    if old is not None:
        path.write_text(old)
    with durable_file(path) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".tif"
        assert temporary.name.startswith(".")
        temporary.write_text("new")
        assert (path.read_text() if path.exists() else None) == old
    assert path.read_text() == "new"
    assert names(tmp_path) == [path.name]


def test_a_text_keeps_its_line_ends(tmp_path: Path) -> None:
    write_text(tmp_path / "table.csv", "a\r\n\u00e9\n")
    assert (tmp_path / "table.csv").read_bytes() == b"a\r\n\xc3\xa9\n"


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
    with pytest.raises(InputError, match="No space left") as caught:  # noqa: SIM117
        with durable_file(path), Path("/dev/full").open("wb", buffering=0) as full:
            full.write(b"x")
    assert str(caught.value) == f"{path}: cannot be written: {os.strerror(errno.ENOSPC)}"
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none/a.txt", "No such file"),
        ("file/a.txt", "Not a directory"),
        ("/proc/a.txt", ""),  # refuses new files even for root
        ("loop", ""),
        ("pipe", "it is not"),
        ("link", "it is not"),
    ],
)
def test_a_path_that_cannot_be_written_is_named_at_once(
    tmp_path: Path, name: str, message: str
) -> None:
    (tmp_path / "file").write_text("mine")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("pipe")
    (tmp_path / "loop").symlink_to("loop")
    before = sorted(names(tmp_path))
    path = tmp_path / name
    with (
        pytest.raises(InputError, match=f"^{path}: cannot be written: {message}"),
        durable_file(path),
    ):
        pytest.fail("the block must not begin")
    assert sorted(names(tmp_path)) == before
    assert (tmp_path / "pipe").is_fifo()


@pytest.mark.parametrize(
    ("name", "message"), [("folder", "Is a directory"), (".", ""), ("", ""), ("..", "")]
)
def test_a_folder_is_not_replaced(tmp_path: Path, monkeypatch, name: str, message: str) -> None:
    (tmp_path / "inner" / "folder").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "inner")
    with (
        pytest.raises(InputError, match=f"cannot be written: {message}"),
        durable_file(Path(name)) as temporary,
    ):
        temporary.write_text("new")
    assert names(tmp_path) == ["inner"]
    assert names(tmp_path / "inner") == ["folder"]


@pytest.mark.parametrize("mask", [0o022, 0o077])
def test_a_new_file_has_usual_permissions_without_setting_the_mask(
    tmp_path: Path, monkeypatch, mask: int
) -> None:
    """A umask of zero for an instant would affect files that other threads create."""
    before = os.umask(mask)
    try:
        with monkeypatch.context() as patched:
            patched.setattr(os, "umask", lambda _: pytest.fail("the mask must not be set"))
            with durable_file(tmp_path / "a.txt") as temporary:
                temporary.write_text("new")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o666 & ~mask


def test_many_writers_of_one_file_leave_one_whole_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"

    def write(letter: str) -> None:
        with durable_file(path) as temporary:
            temporary.write_text(letter * 10_000)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write, "abcdefgh"))
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


@pytest.mark.parametrize("code", [errno.EINVAL, errno.EACCES])
def test_a_folder_that_cannot_be_synced_is_left_at_that(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    """EINVAL is the answer of some network file systems, EACCES that of Windows."""
    call = "fsync" if code == errno.EINVAL else "open"
    really = getattr(os, call)

    def refuse_folders(what: object, *arguments: object) -> object:
        about = os.fstat(what) if isinstance(what, int) else os.stat(what)  # noqa: PTH116
        if stat.S_ISDIR(about.st_mode):
            raise OSError(code, os.strerror(code))
        return really(what, *arguments)

    with durable_file(tmp_path / "a.txt") as temporary:
        temporary.write_text("new")
        monkeypatch.setattr(os, call, refuse_folders)
    assert (tmp_path / "a.txt").read_text() == "new"


def test_a_folder_whose_disk_fails_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(descriptor: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fsync", fail)
    with (
        pytest.raises(InputError, match=r"a\.txt: .*Input/output error"),
        durable_file(tmp_path / "a.txt"),
    ):
        pass
