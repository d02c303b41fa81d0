"""Changes by commands have the rows that the same changes in the panel have."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture.station.domain.folder import StationFolder
from capture.station.domain.recipe_file import RecipeFolder, read_recipe, write_recipe
from capture.station.domain.users import Identity, Role
from capture.station.results.audit import (
    ChangeRecord,
    ResultsAccess,
    changing_on_the_terminal,
    newest_changes,
    system_user,
)
from capture.station.results.database import ResultsUnavailable
from capture.station.results.store import open_store

Ps4rig = Callable[..., Any]
ADA = Identity("ada", Role.ENGINEER, "command")


def rows(station: Path) -> list[ChangeRecord]:
    """The log of changes, the oldest first."""
    with open_store(str(station / "results.sqlite"), "station", exclusive=False) as store:
        return newest_changes(store, 100)[::-1]


def whats(station: Path) -> list[tuple[str, str, str | None, str | None]]:
    return [(row.by, row.what, row.before, row.after) for row in rows(station)]


def test_approving_and_rolling_back_have_rows(
    station: Path, files: RecipeFolder, ps4rig: Ps4rig
) -> None:
    first = read_recipe(files.file)
    named = f"version {first.version}, {first.sha256[:8]}"
    user = system_user()
    assert ps4rig("station", "approve", station, "--by", "Ada").exit_code == 0
    # By hand, in the file.
    write_recipe(files.file, first.model_copy(update={"note": "sheet 7"}))
    second = read_recipe(files.file)
    assert ps4rig("station", "approve", station, "--by", "Bob").exit_code == 0
    listed = ps4rig("station", "roll-back", station).stdout
    assert all(each.sha256[:8] in listed for each in (first, second))
    back = ps4rig("station", "roll-back", station, first.sha256[:8], "--by", "Eve")
    assert back.stdout == f"recipe example: {named}, approved by Ada\n"
    assert read_recipe(files.file).sha256 == first.sha256
    changed = f"version {first.version}, {second.sha256[:8]}"
    assert whats(station) == [
        (f"Ada, on the terminal as {user}", "recipe example", f"{named}, not approved",
         f"{named}, approved by Ada"),
        (f"Bob, on the terminal as {user}", "recipe example", f"{changed}, not approved",
         f"{changed}, approved by Bob; since the last approval: note: nothing -> sheet 7"),
        (f"Eve, on the terminal as {user}", "recipe example", f"{changed}, approved by Bob",
         f"roll back to {named}, approved by Ada"),
    ]  # fmt: skip
    assert {row.role for row in rows(station)} == {"administrator"}
    for wrong in (("0" * 8,), ("",), ("0" * 8, "--recipe", "nobody")):
        assert ps4rig("station", "roll-back", station, *wrong).exit_code == 2
    assert not (station / "recipes/nobody").exists()
    assert len(rows(station)) == 3


def test_an_approval_that_is_refused_has_no_row(
    station: Path, files: RecipeFolder, ps4rig: Ps4rig
) -> None:
    shutil.rmtree(files.version(2).folder)
    assert ps4rig("station", "approve", station, "--by", "Ada").exit_code == 2
    assert ps4rig("station", "approve", station, "--by", " ").exit_code == 2
    assert ps4rig("station", "approve", station, "--by", 201 * "x").exit_code == 2
    assert not (station / "results.sqlite").exists()


def test_changes_of_the_challenge_set_have_rows(
    station: Path, files: RecipeFolder, ps4rig: Ps4rig, tmp_path: Path
) -> None:
    part = shutil.copy(next(files.sets.iterdir()), tmp_path / "seen.ome.tif")
    challenge = ("station", "challenge", station)
    assert ps4rig(*challenge, "--add", part, "--expect", "PASS").exit_code == 0
    assert ps4rig(*challenge, "--add", part, "--expect", "FAIL").exit_code == 0
    assert ps4rig(*challenge, "--remove", "seen.ome.tif", "--by", "Ada").exit_code == 0
    assert ps4rig(*challenge, "--remove", "seen.ome.tif").exit_code == 2
    missing = ps4rig(*challenge, "--add", tmp_path / "nothing.ome.tif", "--expect", "PASS")
    assert missing.exit_code == 2
    assert ps4rig(*challenge, "--remove", "a", "--add", part, "--expect", "PASS").exit_code == 2
    assert ps4rig(*challenge, "--expect", "PASS").exit_code == 2
    what, user = "recipe example: challenge part seen.ome.tif", system_user()
    assert whats(station) == [
        (f"{user}, on the terminal", what, None, "PASS"),
        (f"{user}, on the terminal", what, "PASS", "FAIL"),
        (f"Ada, on the terminal as {user}", what, "FAIL", None),
    ]


@pytest.mark.slow
def test_teaching_has_a_row_at_its_begin_and_one_at_its_end(
    station: Path, files: RecipeFolder, ps4rig: Ps4rig
) -> None:
    before = read_recipe(files.file)
    taught = ps4rig("station", "teach", station, "--by", "Ada")
    assert taught.exit_code == 0
    assert "rock: a scratch 3 px wide " in taught.stdout
    after = read_recipe(files.file)
    assert ps4rig("station", "teach", station, station / "nothing").exit_code == 2
    sets = sorted(files.sets.iterdir())[:1]
    assert ps4rig("station", "teach", station, *sets, "--as", "rock").exit_code == 2
    said = [(row.before, row.after) for row in rows(station)]
    old, new = (f"version {each.version}, {each.sha256[:8]}, not approved"
                for each in (before, after))  # fmt: skip
    assert said[:3] == [
        (old, "teach the known parts again"),
        (old, new),
        (new, f"teach 1 bad part of rock: {sets[0].name}"),
    ]
    assert said[3][1] is not None
    assert "was taught as" in said[3][1]
    assert len(said) == 4


def test_an_override_on_the_terminal_has_the_row_of_one_in_the_panel(
    tmp_path: Path, captured: Any, ps4rig: Ps4rig
) -> None:
    from tests.capture.station.panel.panels import running_panel

    folder = tmp_path / "line-1"
    with running_panel(folder, captured) as panel:
        (part,) = panel.parts(1)
        override = ("station", "override", folder, part, "--verdict", "FAIL", "--by", "Ada")
        assert ps4rig(*override, "--reason", "scratch").exit_code == 0
        assert ps4rig(*override, "--reason", " ").exit_code == 2
        assert ps4rig("station", "override", folder, "nobody", *override[4:],
                      "--reason", "x").exit_code == 2  # fmt: skip
        (row,) = panel.client(Role.ENGINEER).get("/api/v1/audit").json["changes"]
    assert row["by"] == f"Ada, on the terminal as {system_user()}"
    assert (row["what"], row["before"], row["after"]) == (f"part {part}", "PASS", "FAIL: scratch")


def test_the_user_of_the_system_is_not_that_of_the_environment(
    station: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("LOGNAME", "USER", "LNAME", "USERNAME"):
        monkeypatch.setenv(name, "boss")
    with changing_on_the_terminal(StationFolder(station)) as (_, who):
        assert who.name == f"{system_user()}, on the terminal"
        assert "boss" not in who.name


@pytest.mark.parametrize(
    "damage",
    # Each command waits for the server.
    ["lost", "no database", pytest.param("no server", marks=pytest.mark.slow)],
)
def test_no_change_is_made_when_the_results_cannot_be_written(
    station: Path, files: RecipeFolder, ps4rig: Ps4rig, damage: str
) -> None:
    if damage == "lost":  # there are sets of parts, so there were results
        (station / "parts" / "2026-01-02").mkdir(parents=True)
        (station / "parts" / "2026-01-02" / "part-000001.ome.tif").touch()
    elif damage == "no database":
        (station / "results.sqlite").write_bytes(b"nothing" * 1000)
    else:
        config = (station / "station.toml").read_text()
        address = "postgresql://nobody@127.0.0.1:1/nothing"
        (station / "station.toml").write_text(config.replace("results.sqlite", address))
    before = files.file.read_bytes()
    for command in (
        ("approve", station, "--by", "Ada"),
        ("challenge", station, "--remove", "rock-3.ome.tif"),
        ("teach", station),
    ):
        answer = ps4rig("station", *command)
        assert answer.exit_code == 3, answer.stderr
        assert "nothing was changed" in answer.stderr
    assert files.file.read_bytes() == before
    assert not (station / "station.log").exists()
    folder = StationFolder(station)
    with pytest.raises(ResultsUnavailable):
        ResultsAccess(folder).record(ADA, "user kim", None, "operator")
