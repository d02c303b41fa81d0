"""A station that was taught rock as good and sand as bad, with its challenge set."""

import fcntl
import os
import pickle
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.domain.config import CONFIG
from capture.station.domain.folder import StationFolder, make_station
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import RecipeFolder, write_recipe
from capture.station.judge.approval import approve
from capture.station.judge.challenge_set import add_to_challenge
from capture.station.judge.fault_study import large_faults
from capture.station.judge.inspector import Inspector
from capture.station.judge.teaching.teaching import teach
from capture.station.judge.teaching.teaching_result import Teaching
from tests.capture.station.production import configure
from tests.capture.station.stations import small_set
from tests.capture.station.teaching_sets import SIDE_PX, few_places, saved


@pytest.fixture(scope="session", autouse=True)
def teaches_faster() -> Iterator[None]:
    with few_places():
        yield


@pytest.fixture(scope="session")
def captured() -> CapturedSet:
    """A set for stations whose inspector does not look at it."""
    return small_set()


@pytest.fixture(scope="session")
def taught(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Teaching]:
    """The folder of a taught station, not to be changed, and the outcome of teaching."""
    sets = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        sets = sets.parent  # the workers share the station, which takes 6 s to make
    outcome = sets / "taught"
    with (sets / "taught.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not outcome.exists():
            outcome.write_bytes(pickle.dumps(_taught(sets / "to_teach")))
    taught: tuple[Path, Teaching] = pickle.loads(outcome.read_bytes())
    return taught


def _taught(sets: Path) -> tuple[Path, Teaching]:
    folder = sets / "station"
    make_station(folder)
    files = StationFolder(folder).recipe_files()
    write_recipe(
        files.file,
        Recipe(name=files.name, passes=("rock",), acknowledged=("dent", "rotated piece")),
    )
    rock, sand = saved(sets, "rock", range(5)), saved(sets, "sand", range(3))
    teach(files, rock[:4])
    teaching = teach(files, sand[:2], "loose sand")
    add_to_challenge(files.challenge, rock[3:4], "PASS")
    add_to_challenge(files.challenge, sand[2:], "FAIL")
    large_faults(files, Inspector.load(files))  # an approval need not wait for it
    return folder, teaching


@pytest.fixture
def station(taught: tuple[Path, Teaching], tmp_path: Path) -> Path:
    """A copy of the taught station."""
    return shutil.copytree(taught[0], tmp_path / "station")


@pytest.fixture
def files(station: Path) -> RecipeFolder:
    """The recipe of the copy."""
    return StationFolder(station).recipe_files()


@pytest.fixture
def small_rig(station: Path) -> Path:
    """The rig of the copy: a simulated one with small frames."""
    rig = station / "rig.toml"
    side = f"width_px = {SIDE_PX}\nheight_px = {SIDE_PX}\n"
    rig.write_text(f'[lights]\nport = "simulated"\n[camera]\n{side}')
    config = (station / "station.toml").read_text()
    (station / "station.toml").write_text(config.replace('rig = "sim"', 'rig = "rig.toml"'))
    return rig


@pytest.fixture
def line(station: Path, files: RecipeFolder) -> Path:
    """An approved station whose parts are all good."""
    configure(station)
    config = station / CONFIG
    feed = '[simulated_parts]\nsurfaces = ["rock"]\nshare_other = 0.0\nshare_defective = 0.0\n'
    config.write_text(config.read_text().partition("[simulated_parts]")[0] + feed)
    approve(files, "Ada")
    return station
