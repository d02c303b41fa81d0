"""Tests of ``ps4rig station doctor``."""

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from capture.station.domain.folder import StationFolder, keep_recipe
from capture.station.domain.recipe import CameraSettings
from capture.station.domain.recipe_file import RecipeFolder, read_recipe, write_recipe
from capture.station.judge.approval import approve
from capture.station.judge.challenge import require_challenge
from capture.station.judge.inspector import Inspector
from capture.station.results.store import open_store
from tests.capture.station.results.many import fill, many


def statuses(result: Any) -> dict[str, str]:
    return {check["name"]: check["status"] for check in json.loads(result.stdout)["checks"]}


def test_a_station_that_could_run_has_no_fault(
    station: Path, files: RecipeFolder, small_rig: Path, ps4rig: Callable[..., Any]
) -> None:
    assert small_rig
    before = ps4rig("station", "doctor", station, "--json")
    assert before.exit_code == 1
    found = statuses(before)
    assert (found["approval"], found["challenge"]) == ("fault", "warning")
    approve(files, "Ada")
    require_challenge(files, Inspector.load(files))
    after = ps4rig("station", "doctor", station, "--json")
    found = statuses(after)
    assert after.exit_code == 0
    write_recipe(files.file, read_recipe(files.file).model_copy(update={"note": "a draft"}))
    assert statuses(ps4rig("station", "doctor", station, "--json"))["approval"] == "warning"
    names = ("station.toml", "disk", "recipe", "approval", "challenge", "results", "LED order")
    assert [found[name] for name in names] == ["ok"] * len(names)


def test_each_fault_is_one_line_and_the_checks_go_on(
    station: Path,
    files: RecipeFolder,
    small_rig: Path,
    ps4rig: Callable[..., Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with (station / "station.toml").open("a", encoding="utf-8") as config:
        config.write('[modbus]\n[mqtt]\nurl = "mqtt://broker.example"\ntopic = "line"\n')
    monkeypatch.setitem(sys.modules, "paho", None)  # is not installed
    files.version(2).library.unlink()
    small_rig.write_text("[lights]\nport = 1\n")
    small_rig.chmod(0o644)
    result = ps4rig("station", "doctor", station, "--json")
    found = statuses(result)
    assert result.exit_code == 1
    assert (found["recipe"], found["configuration"]) == ("fault", "fault")
    assert (found["disk"], found["results"]) == ("ok", "ok")
    assert (found["modbus"], found["mqtt"]) == ("ok", "fault")
    assert found["permissions"] == "warning"
    assert "pip install 'ps4rig[mqtt]'" in result.stdout


@pytest.mark.parametrize(
    ("before", "after", "difference"),
    [
        ("[lights]", 'name = "line-4"\n[lights]', "rig 'line-4' instead of 'rig'"),
        ("[camera]", "tilts_deg = [90, 0, 180, 270]\n[camera]", "lights in another order"),
        ("[camera]", "slant_deg = 50.0\n[camera]", "differs by 5.0 degrees"),
        ("[camera]", "intensities = [0.5, 0.5, 0.5, 0.5]\n[camera]", "0.5 instead of 1, 1, 1, 1"),
        ("height_px = 256", "height_px = 128", "256 x 128 px instead of 256 x 256 px"),
    ],
)
def test_a_rig_that_is_not_the_taught_one_is_a_fault(
    station: Path,
    files: RecipeFolder,
    small_rig: Path,
    ps4rig: Callable[..., Any],
    before: str,
    after: str,
    difference: str,
) -> None:
    approve(files, "Ada")
    small_rig.write_text(small_rig.read_text().replace(before, after))
    result = ps4rig("station", "doctor", station, "--json")
    texts = [check["seen"] for check in json.loads(result.stdout)["checks"]]
    assert any(difference in text for text in texts)
    assert statuses(result)["taught rig"] == "fault"
    assert result.exit_code == 1


@pytest.mark.parametrize(("exposure_ms", "status"), [(20.0, "ok"), (15.0, "fault")])
def test_the_rig_is_tested_with_the_exposure_of_the_recipe(
    station: Path,
    files: RecipeFolder,
    small_rig: Path,
    ps4rig: Callable[..., Any],
    exposure_ms: float,
    status: str,
) -> None:
    small_rig.write_text(small_rig.read_text().replace("[camera]", "[camera]\nexposure_ms = 15.0"))
    light = CameraSettings(exposure_ms=exposure_ms)
    write_recipe(files.file, read_recipe(files.file).model_copy(update={"light": light}))
    approve(files, "Ada")
    assert statuses(ps4rig("station", "doctor", station, "--json"))["taught rig"] == status


@pytest.mark.parametrize("command", ["doctor", "challenge", "gauge"])
def test_commands_take_the_recipe_with_which_the_next_run_begins(
    station: Path, ps4rig: Callable[..., Any], command: str
) -> None:
    keep_recipe(StationFolder(station), "brass")
    result = ps4rig("station", command, station)
    assert result.exit_code != 0
    assert str(Path("recipes", "brass.toml")) in result.stdout + result.stderr


@pytest.mark.slow
def test_a_gauge_study_counts_the_parts_that_its_recipe_judged(
    station: Path, tmp_path: Path, ps4rig: Callable[..., Any]
) -> None:
    opened, known = StationFolder(station), tmp_path / "known.csv"
    first, *others = many(opened.config.name, 3)
    with open_store(opened.results, opened.config.name, create=True) as store:
        fill(store, [replace(first, recipe="brass"), *others])
    known.write_text("".join(f"{part.part_id},good\n" for part in (first, *others)))

    def presented() -> list[str | int]:
        said = json.loads(ps4rig("station", "gauge", station, "--known", known, "--json").stdout)
        return [said["recipe"], said["presentations"]]

    assert presented() == ["example", 2]
    keep_recipe(StationFolder(station), "brass")
    assert presented() == ["brass", 1]
    keep_recipe(StationFolder(station), "tin")
    none = ps4rig("station", "gauge", station, "--known", known)
    assert (none.exit_code, "none of its 3 parts was judged by recipe tin" in none.stderr) == (
        2,
        True,
    )


def test_a_folder_without_a_station_says_how_to_make_one(
    tmp_path: Path, ps4rig: Callable[..., Any]
) -> None:
    result = ps4rig("station", "doctor", tmp_path, "--json")
    assert result.exit_code == 1
    assert "ps4rig station init" in result.stdout
