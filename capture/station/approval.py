"""Approve a recipe: a person confirms its hash."""

from capture.process.utc_time import utc_text
from rig.config.toml_file import validated

from .inspector import Inspector
from .recipe import Approval, Recipe
from .recipe_file import write_recipe
from .recipe_folder import RecipeFolder


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
    write_recipe(files.version(recipe.version).approved(recipe.sha256), approved)
    write_recipe(files.file, approved)
    return approved
