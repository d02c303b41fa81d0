"""Approve a recipe by its hash, list the approved states, and roll back to one of them."""

from collections.abc import Callable

from capture.base.utc_time import utc_text
from capture.station.domain.errors import RecipeError
from capture.station.domain.recipe import Approval, Recipe
from capture.station.domain.recipe_file import RecipeFolder, read_recipe, write_recipe
from classify.base.errors import InputError
from classify.base.models import read_toml_as, validated

from .fault_study import require_large_faults_found
from .inspector import Inspector

RecordChange = Callable[[Recipe, Recipe], None]
"""Called with the old and the new recipe before the new one is written; may raise to prevent it."""


def approve(
    files: RecipeFolder,
    by: str,
    shown_sha256: str | None = None,
    record: RecordChange = lambda *_: None,
) -> Recipe:
    """Approve the present recipe, and keep a copy in the folder of its version."""
    with files.changing():
        inspector = Inspector.load(files)
        recipe = inspector.recipe
        require_unchanged(recipe, shown_sha256)
        require_large_faults_found(files, inspector)
        # In milliseconds, so that two approvals within a second keep their order.
        utc = utc_text(timespec="milliseconds")
        values = {"by": by, "utc": utc, "sha256": recipe.sha256}
        approval = validated(values, Approval, "approval")
        approved = recipe.model_copy(update={"approval": approval})
        record(recipe, approved)
        write_recipe(files.version(recipe.version).approved(recipe.sha256), approved)
        write_recipe(files.file, approved)
        return approved


def require_unchanged(recipe: Recipe, shown_sha256: str | None) -> None:
    """Check that a recipe still has the hash that its editor was shown; None: no check."""
    if shown_sha256 is not None and recipe.sha256 != shown_sha256:
        raise RecipeError(
            f"recipe {recipe.name}: was changed by somebody else since you saw it; look at it again"
        )


def approved_states(files: RecipeFolder) -> list[Recipe]:
    """Return the approved states of a recipe that have an intact copy, latest first."""
    states = []
    for version in files.taught_versions():
        for copy in files.version(version).folder.glob("approved-*.toml"):
            try:
                recipe = read_toml_as(copy, Recipe, "there is none")
            except InputError:
                continue
            if recipe.is_approved and (recipe.name, recipe.version) == (files.name, version):
                states.append(recipe)
    return sorted(states, key=_approved_at, reverse=True)


def _approved_at(recipe: Recipe) -> tuple[str, int, str]:
    """Sort key of an approval."""
    utc = "" if recipe.approval is None else recipe.approval.utc
    return utc, recipe.version, recipe.sha256


def roll_back(files: RecipeFolder, sha256: str, record: RecordChange = lambda *_: None) -> Recipe:
    """Replace the recipe by an earlier approved state, with its approval."""
    with files.changing():
        state = next(
            (approved for approved in approved_states(files) if approved.sha256 == sha256), None
        )
        if state is None:
            raise RecipeError(f"recipe {files.name}: no approved state has hash {sha256[:64]!r}")
        Inspector.of(state, files)  # raises if the recipe cannot run
        record(read_recipe(files.file), state)
        write_recipe(files.file, state)
        return state
