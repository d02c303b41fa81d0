"""A run that collects parts to teach: no recipe, and no PASS."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.domain.folder import StationFolder, make_station, station_folder
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import write_recipe
from capture.station.domain.verdict import Decision
from capture.station.judge.inspector import COLLECTING_REASON
from capture.station.run.events import (
    PartAnnounced,
    RecipeLoaded,
)
from capture.station.run.live_station import LiveStation
from capture.station.run.run import run_station
from capture.station.run.triggers import TimerTrigger
from classify.base.errors import InputError
from tests.capture.station.production import VIRTUAL, collected, configure


def test_a_station_without_a_recipe_collects_parts_and_passes_none(tmp_path: Path) -> None:
    folder = tmp_path / "line"
    make_station(folder)
    configure(folder)
    live = LiveStation("line", simulated=True)
    with (
        station_folder(folder) as opened,
        pytest.raises(InputError, match=r"no such recipe.*station run --collect"),
    ):
        run_station(opened, VIRTUAL, TimerTrigger(0.0), live)
    events = collected(folder, 2)
    results = [each.result for each in events if isinstance(each, PartAnnounced)]
    assert [(each.verdict.decision, each.verdict.reason) for each in results] == 2 * [
        (Decision.UNKNOWN, COLLECTING_REASON)
    ]
    assert all(each.recipe is each.recipe_sha256 is None for each in results)
    assert not any(isinstance(each, RecipeLoaded) for each in events)
    assert all((folder / str(each.set_file)).is_file() for each in results)


def test_collecting_takes_exposure_and_gain_of_a_recipe_that_is_there(tmp_path: Path) -> None:
    folder = tmp_path / "line"
    make_station(folder)
    configure(folder)
    files = StationFolder(folder).recipe_files()
    recipe = Recipe.model_validate({"name": "example", "pass": [], "light": {"exposure_ms": 12.0}})
    write_recipe(files.file, recipe)
    collected(folder, 1)
    [path] = (folder / "parts").glob("*/*.ome.tif")
    camera = CapturedSet.load(path).metadata.camera
    assert camera.exposure_ms == 12.0


def test_a_run_that_collects_ends_with_status_0(ps4rig: Callable[..., Any], tmp_path: Path) -> None:
    make_station(tmp_path / "line")
    configure(tmp_path / "line")
    rig = tmp_path / "rig.toml"
    rig.write_text(
        "[lights]\nport = 'simulated'\n[camera]\nkind = 'simulated'\nwidth_px = 64\n"
        "height_px = 64\n"
        "[simulation]\nclock = 'virtual'\n"
    )
    options = ("--rig", rig, "--collect", "--no-panel", "--trigger", "timer", "--parts", 1)
    ran = ps4rig("station", "run", tmp_path / "line", *options)
    assert ran.exit_code == 0
