"""The first recipe of a run: the last loaded, or that of ``station.toml``."""

from typing import Literal

from pydantic import ValidationError

from capture.session.plan import Name
from classify.base.durable_file import durable_file
from classify.base.errors import InputError
from classify.base.regular_file import read_regular_file
from classify.base.section import Record
from rig.config.validation_message import first_fault

from .folder import StationFolder

FILE = "loaded-recipe.json"
_MAX_BYTES = 1 << 12


class LastRecipe(Record):
    """The recipe that was loaded last, and the one of ``station.toml`` at that time."""

    format: Literal["ps4rig-loaded-recipe"] = "ps4rig-loaded-recipe"
    version: Literal[1] = 1
    configured: Name
    loaded: Name


def first_recipe(folder: StationFolder) -> str:
    """Return the recipe with which a run begins: the last loaded one, for the parts on the line.

    A `recipe` in ``station.toml`` that differs from the one at that time is newer.
    """
    path, configured = folder.path / FILE, folder.config.recipe
    if not path.exists():
        return configured
    try:
        last = LastRecipe.model_validate_json(read_regular_file(path, _MAX_BYTES))
    except ValidationError as error:
        raise InputError(
            f"{path}: {first_fault(error)}; remove it to begin with recipe {configured}"
        ) from error
    return last.loaded if last.configured == configured else configured


def keep_recipe(folder: StationFolder, name: str) -> None:
    """Store the recipe with which the next run begins; InputError if it cannot be written."""
    last = LastRecipe(configured=folder.config.recipe, loaded=name)
    with durable_file(folder.path / FILE) as temporary:
        temporary.write_text(last.model_dump_json(indent=1), encoding="utf-8")
