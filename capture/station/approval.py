"""Approve a recipe: a person confirms its hash."""

from capture.process.utc_time import utc_text
from rig.config.toml_file import validated

from .inspector import Inspector
from .recipe import Approval, Recipe
from .recipe_file import write_recipe
from .recipe_folder import RecipeFolder

# Digits of the hash in the name of the copy of an approved recipe.
_DIGITS = 8


def approve(files: RecipeFolder, by: str) -> Recipe:
    """Approve a recipe as it is, and keep a copy of it beside what was taught.

    Raises
    ------
    RecipeError
        If the recipe could not be run: it was not taught, or something was changed since.
    ConfigError
        For a name that is empty or does not print.
    """
    recipe = Inspector.load(files).recipe
    values = {"by": by, "utc": utc_text(), "sha256": recipe.sha256}
    approval = validated(values, Approval, "approval")
    approved = recipe.model_copy(update={"approval": approval})
    copy = files.version(recipe.version).folder / f"approved-{recipe.sha256[:_DIGITS]}.toml"
    write_recipe(copy, approved)
    write_recipe(files.file, approved)
    return approved
