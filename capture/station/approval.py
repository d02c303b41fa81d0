"""Approve a recipe: a person confirms its hash. Go back to a state that was approved."""

from capture.process.utc_time import utc_text
from classify.errors import InputError
from rig.config.toml_file import read_toml_as, validated

from .errors import RecipeError
from .inspector import Inspector
from .recipe import Approval, Recipe
from .recipe_file import write_recipe
from .recipe_folder import RecipeFolder


def approve(files: RecipeFolder, by: str, seen_sha256: str | None = None) -> Recipe:
    """Approve a recipe as it is, and keep a copy of it beside what was taught.

    Parameters
    ----------
    by
        Who approves it.
    seen_sha256
        Hash of the recipe that this person has seen; None for whatever it is.

    Raises
    ------
    RecipeError
        If the recipe could not be run: it was not taught, or something was changed since. If it is
        not the one that was seen.
    ConfigError
        For a name that is empty or does not print.
    """
    with files.changing():
        recipe = Inspector.load(files).recipe
        require_seen(recipe, seen_sha256)
        values = {"by": by, "utc": utc_text(), "sha256": recipe.sha256}
        approval = validated(values, Approval, "approval")
        approved = recipe.model_copy(update={"approval": approval})
        write_recipe(files.version(recipe.version).approved(recipe.sha256), approved)
        write_recipe(files.file, approved)
        return approved


def require_seen(recipe: Recipe, seen_sha256: str | None) -> None:
    """Check that a recipe is the one that somebody has seen.

    Raises
    ------
    RecipeError
        If it was changed since; None is whatever it is.
    """
    if seen_sha256 is not None and recipe.sha256 != seen_sha256:
        raise RecipeError(
            f"recipe {recipe.name}: was changed by somebody else since you saw it; look at it again"
        )


def approved_states(files: RecipeFolder) -> list[Recipe]:
    """Return every state of a recipe that was approved, the last approval first.

    A copy that is damaged or was changed since is left out: nobody can go back to it.
    """
    found = []
    for version in files.taught_versions():
        for copy in files.version(version).folder.glob("approved-*.toml"):
            try:
                recipe = read_toml_as(copy, Recipe, "there is none")
            except InputError:
                continue
            if recipe.is_approved and (recipe.name, recipe.version) == (files.name, version):
                found.append(recipe)
    return sorted(found, key=lambda each: each.approval.utc if each.approval else "", reverse=True)


def roll_back(files: RecipeFolder, sha256: str) -> Recipe:
    """Make a state that was approved earlier the recipe again, with its approval.

    Later versions stay on disk. The challenge set must be met again before the recipe runs.

    Raises
    ------
    RecipeError
        If no such state was approved, or what was taught for it was changed since.
    """
    with files.changing():
        state = next((each for each in approved_states(files) if each.sha256 == sha256), None)
        if state is None:
            raise RecipeError(f"recipe {files.name}: {sha256[:64]!r} is no state that was approved")
        Inspector.of(state, files)  # it could run
        write_recipe(files.file, state)
        return state
