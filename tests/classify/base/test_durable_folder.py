"""Folders of results: replaced as a whole, and other files stay."""

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from classify.base.durable_file import durable_folder
from classify.base.errors import InputError

NAMES = ("index", "a", "b")


def write(folder: Path, text: str, *names: str, error: BaseException | None = None) -> None:
    with durable_folder(folder, NAMES, marker="index") as temporary:
        for name in names or NAMES:
            (temporary / name).write_text(text)
        if error is not None:
            raise error


def held(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file()}


def test_a_result_replaces_the_one_before_as_a_whole(tmp_path: Path) -> None:
    folder = tmp_path / "x" / "maps"
    write(folder, "old")
    write(folder, "new", "index", "a")
    assert held(folder) == {"index": "new", "a": "new"}
    assert list(folder.parent.iterdir()) == [folder]


@pytest.mark.parametrize("error", [OSError(28, "full"), KeyboardInterrupt()])
def test_an_interruption_leaves_the_old_result_whole(tmp_path: Path, error: BaseException) -> None:
    write(tmp_path / "maps", "old")
    wanted = InputError if isinstance(error, OSError) else KeyboardInterrupt
    for folder in (tmp_path / "maps", tmp_path / "none"):
        with pytest.raises(wanted):
            write(folder, "new", "a", error=error)
    assert held(tmp_path / "maps") == dict.fromkeys(NAMES, "old")
    assert list(tmp_path.iterdir()) == [tmp_path / "maps"]


def test_other_files_in_the_folder_stay(tmp_path: Path) -> None:
    write(tmp_path, "old")
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "sub").mkdir()
    write(tmp_path, "new", "index", "b")
    assert held(tmp_path) == {"index": "new", "b": "new", "notes.txt": "mine"}
    assert (tmp_path / "sub").is_dir()


def test_the_working_folder_stays_the_same_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "maps").mkdir()
    monkeypatch.chdir(tmp_path / "maps")
    write(Path(), "new")
    assert sorted(os.listdir()) == sorted(NAMES)  # noqa: PTH208 - of the working folder


def test_a_link_is_followed(tmp_path: Path) -> None:
    write(tmp_path / "real", "old")
    (tmp_path / "link").symlink_to("real")
    write(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert held(tmp_path / "real") == dict.fromkeys(NAMES, "new")


def test_a_file_in_the_place_of_the_folder_stays(tmp_path: Path) -> None:
    (tmp_path / "maps").write_text("mine")
    with pytest.raises(InputError, match=r"maps: .*File exists"):
        write(tmp_path / "maps", "new")
    assert held(tmp_path) == {"maps": "mine"}


def test_many_writers_share_a_parent_folder(tmp_path: Path) -> None:
    def write(number: int) -> None:
        with durable_folder(tmp_path / str(number), ["p.tif"], "p.tif") as temporary:
            (temporary / "p.tif").write_text(str(number))

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write, range(400)))
    assert {path.name for path in tmp_path.iterdir()} == {str(number) for number in range(400)}
