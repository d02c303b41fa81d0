"""Read the files that teaching made for a recipe, and check that none was changed since."""

from pathlib import Path

from capture.station.errors import RecipeError
from classify.defects.defect_model import DefectModel

from .recipe import Recipe
from .recipe_folder import RecipeFolder, TaughtFiles
from .taught import Taught, read_taught


def taught_for(recipe: Recipe, files: RecipeFolder) -> Taught:
    """Read the measurements of teaching for a recipe, and check that they cover the recipe.

    Raises
    ------
    RecipeError
        If the recipe was not taught, or something was changed since.
    """
    if recipe.taught is None:
        raise RecipeError(f"{files.file}: was never taught; run ps4rig station teach")
    path = files.version(recipe.version).taught
    taught = read_taught(path)
    check_unchanged(recipe, path, taught.sha256, recipe.taught)
    if taught.region != recipe.region:
        raise RecipeError(
            f"{files.file}: region is {recipe.region or 'the whole image'}, taught was "
            f"{taught.region or 'the whole image'}; run ps4rig station teach"
        )
    missing = next((name for name in recipe.passes if name not in taught.textures), None)
    if missing is not None or not recipe.passes:
        named = "is empty" if missing is None else f"names {missing!r}, which was not taught"
        raise RecipeError(
            f"{files.file}: pass {named}; taught are {', '.join(map(repr, taught.textures))}; "
            "correct pass, or run ps4rig station teach"
        )
    for name in recipe.passes:
        _defects_of(recipe, taught, name)
    return taught


def defect_model_of(made: TaughtFiles, recipe: Recipe, taught: Taught, texture: str) -> DefectModel:
    """Load the defect model of a texture that passes.

    Raises
    ------
    RecipeError
        If it was taught as a bad texture, or the file was changed since teaching.
    DefectModelError
        If the file cannot be read.
    """
    file, sha256 = _defects_of(recipe, taught, texture)
    path = made.folder / file
    model = DefectModel.load(path)
    check_unchanged(recipe, path, model.sha256, sha256)
    return model


def check_unchanged(recipe: Recipe, path: Path, found: str, taught: str) -> None:
    """Check that a file has the hash that it had when the recipe was taught.

    Raises
    ------
    RecipeError
        If its hash differs.
    """
    if found != taught:
        raise RecipeError(
            f"{path}: was changed since recipe {recipe.name} was taught; run ps4rig station teach"
        )


def _defects_of(recipe: Recipe, taught: Taught, texture: str) -> tuple[str, str]:
    """Name of the file of the defect model of a texture, and its hash."""
    about = taught.textures[texture]
    if about.defects_file is None or about.defects_sha256 is None:
        raise RecipeError(
            f"recipe {recipe.name}: pass names {texture!r}, which was taught as a bad texture; run "
            "ps4rig station teach"
        )
    return about.defects_file, about.defects_sha256
