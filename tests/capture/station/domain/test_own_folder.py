"""The folder of a station: its owner alone uses it, no link is followed, others read nothing."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from capture.station.domain.folder import StationFolder, make_station
from capture.station.domain.own_folder import too_open
from classify.base.errors import InputError

Ps4rig = Callable[..., Any]


@pytest.fixture
def usual_umask() -> Iterator[None]:
    before = os.umask(0o022)
    yield
    os.umask(before)


@pytest.fixture
def line(tmp_path: Path) -> Path:
    make_station(tmp_path / "line")
    return tmp_path / "line"


def modes(folder: Path) -> dict[str, int]:
    paths = [folder, *folder.rglob("*")]
    return {str(path.relative_to(folder)): path.stat().st_mode & 0o777 for path in paths}


@pytest.mark.usefixtures("usual_umask")
def test_nothing_that_a_command_makes_is_open_to_other_users(
    tmp_path: Path, ps4rig: Ps4rig
) -> None:
    line = tmp_path / "line"
    assert ps4rig("station", "init", line).exit_code == 0
    assert ps4rig("station", "token", "add", line, "mes", "--role", "operator").exit_code == 0
    found = modes(line)
    assert found["."] == 0o750
    assert found["results.sqlite"] == found["station.log"] == 0o640
    assert found["tokens.json"] == 0o600
    assert [name for name, mode in found.items() if mode & 0o027] == []
    assert too_open(line) == []


def test_what_is_open_to_other_users_is_named(line: Path) -> None:
    (line / "station.toml").chmod(0o644)
    (line / "users.json").write_text("{}")
    (line / "users.json").chmod(0o640)
    named = {path.name for path in too_open(line)}
    assert {"station.toml", "users.json"} <= named
    assert "line" not in named


def test_another_user_is_refused_root_too(line: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: line.stat().st_uid + 1)
    with pytest.raises(InputError, match=r"belongs to .*sudo -u"):
        StationFolder(line)
    assert StationFolder(line, is_foreign=True).config.name == "line"


@pytest.mark.parametrize("name", ["station.log", "users.json", "results.sqlite", "recipes/a.toml"])
def test_a_link_is_refused(line: Path, tmp_path: Path, name: str) -> None:
    (tmp_path / "secret").write_text("secret")
    (line / name).unlink(missing_ok=True)
    (line / name).symlink_to(tmp_path / "secret")
    with pytest.raises(InputError, match="is a link"):
        StationFolder(line)
