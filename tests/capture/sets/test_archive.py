"""Finding captured sets below folders, and naming folders for their results."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture.sets.archive import find_sets, output_folders
from classify import InputError

Command = Callable[..., Any]


@pytest.fixture
def archive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Empty files: two sets called a, one called b, and files that are not sets."""
    for name in ("x/a.ome.tif", "x/y/a.ome.tif", "b.ome.tif", "x/notes.txt", "x/p.tif"):
        path = tmp_path / "archive" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path)
    return Path("archive")


def test_sets_below_a_folder_are_found(archive: Path) -> None:
    assert find_sets([archive]) == [
        archive / "b.ome.tif", archive / "x" / "a.ome.tif", archive / "x" / "y" / "a.ome.tif",
    ]  # fmt: skip
    # A file given by name may have any suffix.
    text = archive / "x" / "notes.txt"
    assert find_sets([text, archive / "x" / "y"]) == [text, archive / "x" / "y" / "a.ome.tif"]


def test_a_set_that_is_named_twice_counts_once(archive: Path) -> None:
    named = [archive, archive / "x" / "a.ome.tif", archive / "x" / ".." / "b.ome.tif"]
    assert find_sets(named) == find_sets([archive])


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("none", "none: no such file"),
        ("empty", r"empty: holds no"),
    ],
)
def test_an_error_names_the_place_without_sets(archive: Path, place: str, message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}"):
        find_sets([archive, Path(place)])


@pytest.mark.parametrize(
    ("places", "folders"),
    [
        (["archive/b.ome.tif"], ["out"]),
        (["archive/x/y"], ["out/a"]),
        (["archive"], ["out/b", "out/x/a", "out/x/y/a"]),
        (["archive/x/a.ome.tif", "archive/x/y/a.ome.tif"], ["out/a", "out/y/a"]),
        (["archive/x/y", "archive/b.ome.tif"], ["out/x/y/a", "out/b"]),
        (["archive/x/../b.ome.tif", "archive/x"], ["out/b", "out/x/a", "out/x/y/a"]),
        (["archive/b.ome.tif", "archive/b.ome.tif"], ["out/b"]),
    ],
)
@pytest.mark.usefixtures("archive")
def test_each_set_has_a_different_folder(places: list[str], folders: list[str]) -> None:
    found = output_folders([Path(place) for place in places], Path("out"))
    assert [str(folder) for folder in found.values()] == folders


def test_solve_of_several_sets_answers_with_a_list(
    ps4rig: Command, sets: Path, tmp_path: Path
) -> None:
    paths = [sets / "rock-001.ome.tif", sets / "sand-001.ome.tif"]
    one = json.loads(ps4rig("solve", paths[0], "--out", tmp_path / "one", "--json").stdout)
    both = json.loads(ps4rig("solve", *paths, "--out", tmp_path / "both", "--json").stdout)
    assert [row["set"] for row in both] == list(map(str, paths))
    assert list(both[0]) == list(one)
    assert str(tmp_path / "both" / "sand-001" / "p.tif") in both[1]["files"]
    assert both[0]["files"] == [
        name.replace(str(tmp_path / "one"), str(tmp_path / "both" / "rock-001"))
        for name in one["files"]
    ]
    assert all(Path(name).is_file() for row in both for name in row["files"])
    plain = ps4rig("solve", *paths, "--out", tmp_path / "both")
    assert plain.stdout.startswith(f"{tmp_path / 'both' / 'rock-001'}: ")


def test_relight_takes_a_tilt_and_a_slant(
    ps4rig: Command, refused: Callable[..., str], sets: Path, tmp_path: Path
) -> None:
    rock = sets / "rock-001.ome.tif"
    for name, options in (("a", ()), ("b", ("--relight", "135,45")), ("c", ("--relight", "0,30"))):
        assert ps4rig("solve", rock, "--out", tmp_path / name, *options).exit_code == 0
    relit = {name: (tmp_path / name / "relit.tif").read_bytes() for name in "abc"}
    assert relit["a"] == relit["b"] != relit["c"]
    for wrong, message in (
        ("135", "--relight 135: give tilt and slant in degrees, such as 135,45"),
        ("up,45", "--relight up,45: give degrees separated by commas, such as 135,45"),
        ("0,95", "slant 95.0 is outside"),
    ):
        assert message in refused("solve", rock, "--out", tmp_path / "d", "--relight", wrong)
    assert not (tmp_path / "d").exists()
