"""Recipe, solver and defect model that judged a part, by the hashes of its result."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from capture.station.domain.errors import RecipeError
from capture.station.domain.folder import StationFolder
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import RecipeFolder
from capture.station.domain.taught import models_of, read_taught
from capture.station.results.history import HistoryEntry
from capture.station.results.part_result import PartResult
from classify import DefectModel, Method, TextureLibrary
from classify.base.errors import InputError
from classify.base.models import read_toml_as

from .security import Denied


@dataclass(frozen=True, eq=False)
class JudgedBy:
    """Recipe, solver and defect model that judged a part."""

    recipe: Recipe  # as it was when it judged the part
    method: Method | None  # None for the default of the lights
    defect_model: DefectModel | None  # None for a texture that does not pass


def recipe_of(folder: StationFolder, result: PartResult) -> Recipe:
    """Return the recipe that judged a part, as it was then."""
    if result.recipe is None or result.recipe_sha256 is None:
        raise RecipeError("the part was judged by no recipe")
    files = folder.recipe_files(result.recipe)
    return _recipe(files, result.recipe_version or 1, result.recipe_sha256)


def judged_by(folder: StationFolder, result: PartResult) -> JudgedBy:
    """Return recipe, solver and defect model that judged a part."""
    recipe = recipe_of(folder, result)
    files = folder.recipe_files(recipe.name)
    return _judged_by(files, recipe.version, recipe.sha256, result.label or result.nearest)


# A station runs one recipe at a time. People also look at parts of earlier recipes.
@lru_cache(maxsize=4)
def _judged_by(files: RecipeFolder, version: int, sha256: str, texture: str | None) -> JudgedBy:
    recipe = _recipe(files, version, sha256)
    version_files = files.version(version)
    taught = read_taught(version_files.taught)
    if taught.sha256 != recipe.taught:
        raise RecipeError(f"{version_files.taught}: was changed since the part was judged")
    model = None
    if texture is not None and texture in recipe.passes:
        model = models_of(version_files, recipe, taught, texture).defects
    return JudgedBy(recipe, TextureLibrary.load(version_files.library).method, model)


def _recipe(files: RecipeFolder, version: int, sha256: str) -> Recipe:
    """Return the recipe with a hash: an approved copy, or the present recipe."""
    paths: tuple[Path, ...] = (files.version(version).approved(sha256), files.file)
    for path in paths:
        try:
            recipe = read_toml_as(path, Recipe, "no such recipe")
        except InputError:
            continue
        if recipe.sha256 == sha256:
            return recipe
    raise RecipeError(f"recipe {files.name}, version {version}: is not kept as it was then")


def stored_set(folder: StationFolder, entry: HistoryEntry) -> Path:
    """Return the set file of a part."""
    result = entry.result
    if result.set_file is None:
        raise Denied(404, f"part {result.part_id}: no set was captured")
    path = (folder.path / result.set_file).resolve()
    if not path.is_relative_to(folder.parts.resolve()) or not path.is_file():
        when = entry.set_removed_utc
        reason = f"was removed by the retention on {when[:10]}" if when else "is missing"
        raise Denied(410 if when else 404, f"part {result.part_id}: its set file {reason}")
    return path
