"""A station with two recipes: parts of rock pass by one, and do not by the other."""

from pathlib import Path

from capture.station.domain.config import CONFIG
from capture.station.domain.folder import StationFolder
from capture.station.judge.approval import approve
from capture.station.judge.challenge_set import add_to_challenge
from capture.station.judge.teaching.teaching import teach
from capture.station.results.audit import newest_changes
from capture.station.results.part_result import PartResult
from capture.station.results.store import open_store
from tests.capture.station.production import taught_station
from tests.capture.station.teaching_sets import acknowledge_faults, saved

ROCK, SAND = RECIPES = "example", "sand"
_MOST_CHANGES = 1 << 30


def add_second_recipe(folder: Path, sets: Path) -> None:
    """Give the taught station in `folder` a recipe by which sand passes, and parts of rock alone.

    Both recipes are approved.
    """
    station = StationFolder(folder)
    files = station.recipe_files(SAND)
    sand, rock = saved(sets, "sand", range(5)), saved(sets, "rock", range(3, 4))
    teach(files, sand[:4])
    acknowledge_faults(files)
    add_to_challenge(files.challenge, sand[4:], "PASS")
    add_to_challenge(files.challenge, rock, "UNKNOWN")
    for name in (ROCK, SAND):
        approve(station.recipe_files(name), "Ada")
    config = folder / CONFIG
    text = config.read_text(encoding="utf-8")
    feed = 'others = ["sand"]', "share_other = 0.02", "share_defective = 0.05"
    for line, changed in zip(
        feed, ("others = []", "share_other = 0.0", "share_defective = 0.0"), strict=True
    ):
        text = text.replace(line, changed)
    config.write_text(text, encoding="utf-8")


def rows_of(folder: Path) -> dict[int, PartResult]:
    """The results of a station, by number."""
    station = StationFolder(folder)
    with open_store(station.results, station.config.name, exclusive=False) as store:
        return {entry.result.number: entry.result for entry in store.parts()}


def recipe_changes(folder: Path) -> int:
    """How often another recipe was to be loaded."""
    station = StationFolder(folder)
    with open_store(station.results, station.config.name, exclusive=False) as store:
        return len(newest_changes(store, _MOST_CHANGES))


def station_with_two_recipes(place: Path, **config: object) -> Path:
    """Make a station whose PLC needs now one recipe, now another one; see `taught_station`."""
    folder = taught_station(place / "line-1", **config)
    add_second_recipe(folder, place / "shown")
    return folder
