"""The folder of a station: configuration, recipes, parts and log."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from capture.base.folder_lock import folder_lock
from capture.base.names import SET_SUFFIX, Name, file_name
from capture.base.outputs import append_line, escaped
from capture.base.utc_time import utc_text
from classify.base.durable_file import durable_file, make_folder
from classify.base.errors import InputError
from classify.base.models import Record
from rig import RigConfig
from rig.config.rig import config_of

from .config import CONFIG, SIM, StationConfig, example_config, read_config
from .errors import RecipeError
from .own_folder import require_own_folder
from .recipe_file import RecipeFolder

RECIPES, PARTS, LOG = "recipes", "parts", "station.log"
_LOCK = "station.lock"
# A larger log is renamed to station.log.1: after about 80,000 parts with a line of 100 bytes each.
_MAX_LOG_BYTES = 8 << 20
LAST_RECIPE = "loaded-recipe.json"
_MAX_RECIPE_BYTES = 1 << 12


class StationFolder:
    """A station on disk, for reading; `station_folder` opens one for writing.

    Unless `is_foreign`, the folder must belong to the user.
    """

    def __init__(self, path: Path, *, is_foreign: bool = False) -> None:
        if not is_foreign:
            require_own_folder(path)
        self.path = path
        self.config: StationConfig = read_config(path / CONFIG)

    @property
    def parts(self) -> Path:
        """Folder of the captured sets of all parts, with one folder for each day."""
        return self.path / PARTS

    @property
    def rig(self) -> str:
        """The rig to open: ``sim`` or a path."""
        return SIM if self.config.rig == SIM else str(self.path / self.config.rig)

    @property
    def results(self) -> str:
        """The database of results: a URL, or a path."""
        results = self.config.results
        return results if "://" in results else str(self.path / results)

    def rig_config(self) -> RigConfig:
        """Read the configuration of its rig; raises InputError if there is none, or it is wrong."""
        return config_of(self.rig)

    def recipe_files(self, recipe: str | None = None) -> RecipeFolder:
        """Return the files of a recipe, by default those of the configured one."""
        try:
            name = file_name(recipe or self.config.recipe)
        except ValueError as error:
            raise RecipeError(f"recipe {error}") from error
        return RecipeFolder(self.path / RECIPES / name)

    def has_sets(self) -> bool:
        """Whether sets of parts exist; a new database counts from 1 and would overwrite them."""
        return any(self.parts.glob(f"*/*{SET_SUFFIX}"))

    def log(self, line: str) -> None:
        """Append a line with the time to ``station.log``; a full log becomes ``station.log.1``."""
        path = self.path / LOG
        try:
            if path.exists() and path.stat().st_size > _MAX_LOG_BYTES:
                path.replace(path.with_name(f"{LOG}.1"))
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
        append_line(path, f"{utc_text(timespec='milliseconds')} {escaped(line)}")


def set_file_of(part_id: str, triggered_utc: str) -> str:
    """Return the set file of a part, relative to the station: one folder for each UTC day."""
    return f"{PARTS}/{triggered_utc[:10]}/{part_id}{SET_SUFFIX}"


@contextmanager
def station_folder(path: Path) -> Iterator[StationFolder]:
    """Open a station for writing, for this program alone."""
    StationFolder(path)  # raises before a lock file is made in a folder that is not a station
    with folder_lock(path, _LOCK):
        yield StationFolder(path)


def make_station(path: Path) -> None:
    """Make the folder of a station with a commented configuration."""
    if (path / CONFIG).exists():
        raise InputError(f"{path}: is a station already; edit {path / CONFIG}")
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise InputError(f"{path}: exists and is not empty; give another folder")
    for folder in (path / RECIPES, path / PARTS):
        make_folder(folder)
    path.chmod(0o750)
    # Written last, so that a folder with a configuration is complete.
    with durable_file(path / CONFIG) as temporary:
        temporary.write_text(example_config(path.absolute().name), encoding="utf-8")
        read_config(temporary)  # a folder whose name cannot name a station is refused


class _LastRecipe(Record):
    """The recipe that was loaded last, and the one of ``station.toml`` at that time."""

    format: Literal["ps4rig-loaded-recipe"] = "ps4rig-loaded-recipe"
    version: Literal[1] = 1
    configured: Name
    loaded: Name


def first_recipe(folder: StationFolder) -> str:
    """Return the recipe of the next run: the last loaded one, or that of ``station.toml``.

    The latter counts if it was changed since.
    """
    path, configured = folder.path / LAST_RECIPE, folder.config.recipe
    if not path.exists():
        return configured
    advice = f"remove it to begin with recipe {configured}"
    last = _LastRecipe.read(path, _MAX_RECIPE_BYTES, advice)
    return last.loaded if last.configured == configured else configured


def keep_recipe(folder: StationFolder, name: str) -> None:
    """Store the recipe with which the next run begins; InputError if it cannot be written."""
    _LastRecipe(configured=folder.config.recipe, loaded=name).write(folder.path / LAST_RECIPE)
