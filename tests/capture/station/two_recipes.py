"""A station with two recipes: parts of rock pass by one, and do not by the other."""

from pathlib import Path

from capture.station.domain.config import CONFIG
from capture.station.domain.folder import StationFolder
from capture.station.judge.approval import approve
from capture.station.judge.challenge_set import add_to_challenge
from capture.station.judge.teaching.teaching import teach
from tests.capture.station.teaching_sets import acknowledge_faults, saved

ROCK, SAND = "example", "sand"


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
