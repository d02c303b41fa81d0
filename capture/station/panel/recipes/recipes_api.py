"""Recipes by HTTP: state, settings, approval, roll back, teaching, challenge set."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter
from pydantic import Field, JsonValue, conlist
from starlette.responses import Response

from capture.station.domain.recipe import Recipe, Sha256
from capture.station.domain.recipe_file import RecipeFolder, read_recipe
from capture.station.domain.taught import read_taught
from capture.station.judge.approval import approved_states
from capture.station.judge.challenge import Replay
from capture.station.judge.challenge_set import Expected, challenge_sets
from capture.station.judge.recipe_changes import RecipeChanges
from capture.station.judge.recipe_settings import SettingsRefused, dotted
from capture.station.panel.answers import JsonAnswer, Name, answer
from capture.station.panel.background_jobs import Job
from capture.station.panel.guard import V1, ByEngineer, ByOperator, Call
from capture.station.panel.security import Denied
from capture.station.run.events import RecipeLoaded
from capture.station.run.triggers import RecipeRefused
from classify.base.errors import InputError
from classify.base.models import Record

from .recipe_pages import changes_of_existing, changes_of_new_or_existing, load_recipe, recipe_names
from .recipe_work import MAX_CHOSEN_PARTS, add_parts_to_challenge, start_replay, start_teaching

router = APIRouter(prefix=V1)
_RECIPE_PATH, _JOB_URL = "/recipes/{name}", f"{V1}/job"
_PartIds = Annotated[list[str], Field(max_length=MAX_CHOSEN_PARTS, description="ids of parts")]
_Recipe = answer(
    "Recipe",
    **{key: (field.annotation, field) for key, field in Recipe.model_fields.items()},
    sha256=Sha256,
)
_RecipeStatus = answer(
    "RecipeNow",
    _Recipe,
    is_approved=bool,
    problem=str | None,
    challenge=str,
    has_met_challenge=bool,
    is_running=bool,
    least_found=list[dict[str, Any]],
)
_Recipes = answer("Recipes", recipes=list[str], configured=str, running=RecipeLoaded | None)
_Versions = answer("Versions", present=Sha256, approved=conlist(_Recipe), taught=list[int])
_Loaded = answer("Loaded", running=RecipeLoaded)
_Sets = answer("Sets", sets=dict[str, Expected])
_Challenge = answer(
    "Challenge",
    _Sets,
    state=str,
    has_met_challenge=bool,
    last_replay=Replay | None,
)


class SeenRecipe(Record):
    """Hash of the recipe as the client read it; to roll back, of the state to restore.

    Settings and approvals are refused if the recipe has changed since.
    """

    sha256: Sha256


class LoadFields(Record):
    """Hash of the recipe as the client read it; without it, the recipe is loaded as it is."""

    sha256: Sha256 | None = None


_PRESENT = LoadFields()


class SettingsFields(SeenRecipe):
    """New settings; each key replaces the whole setting."""

    settings: dict[str, JsonValue]


class TeachFields(Record):
    """Parts to teach; without any, the parts that were taught before are taught again."""

    parts: _PartIds = Field([])
    texture: str = ""
    use: Literal["good", "bad"] = "good"


class ChallengeFields(Record):
    """Parts for the challenge set; reject is any verdict but PASS."""

    parts: Annotated[_PartIds, Field(min_length=1)]
    expected: Expected


@router.get("/recipes", response_model=_Recipes)
def _recipes(call: ByOperator) -> dict[str, Any]:
    """Names of the recipes, and which one runs."""
    return {
        "recipes": recipe_names(call),
        "configured": call.panel.folder.config.recipe,
        "running": call.panel.live.snapshot().recipe,
    }


@router.get(_RECIPE_PATH, response_model=_RecipeStatus)
def _recipe(call: ByOperator, name: Name) -> Response:
    """A recipe with its approval, its problem if any, and the state of its challenge set."""
    return JsonAnswer(_recipe_status(call, changes_of_existing(call, name)))


def _recipe_status(call: Call, changes: RecipeChanges) -> dict[str, Any]:
    state = changes.state
    loaded = call.panel.live.snapshot().recipe
    return _fields(state.recipe) | {
        "is_approved": state.recipe.is_approved,
        "problem": state.problem,
        "challenge": state.challenge,
        "has_met_challenge": state.has_met_challenge,
        "is_running": loaded is not None and loaded.sha256 == state.recipe.sha256,
        "least_found": _detection_limits(changes.files, state.recipe),
    }


def _detection_limits(files: RecipeFolder, recipe: Recipe) -> list[dict[str, Any]]:
    try:
        return read_taught(files.version(recipe.version).taught).least_found_fields
    except InputError:
        return []


def _fields(recipe: Recipe) -> dict[str, Any]:
    return recipe.model_dump(mode="json", by_alias=True) | {"sha256": recipe.sha256}


@router.get(f"{_RECIPE_PATH}/versions", response_model=_Versions)
def _versions(call: ByOperator, name: Name) -> Response:
    """States of a recipe to go back to."""
    files = changes_of_existing(call, name).files
    return JsonAnswer(
        {
            "present": read_recipe(files.file).sha256,
            "approved": [_fields(recipe) for recipe in approved_states(files)],
            "taught": files.taught_versions(),
        }
    )


@router.post(f"{_RECIPE_PATH}/settings", response_model=_RecipeStatus)
def _save_settings(call: ByEngineer, name: Name, body: SettingsFields) -> Response:
    """Change settings; the changed recipe is not approved."""
    changes = changes_of_existing(call, name)
    try:
        changes.save_settings(body.sha256, body.settings)
    except SettingsRefused as error:
        messages = {dotted(place): message for place, message in error.messages.items()}
        return JsonAnswer({"error": str(error), "settings": messages}, 400)
    return JsonAnswer(_recipe_status(call, changes))


@router.post(f"{_RECIPE_PATH}/approve", response_model=_RecipeStatus)
def _approve(call: ByEngineer, name: Name, body: SeenRecipe) -> Response:
    """Approve a recipe."""
    changes = changes_of_existing(call, name)
    changes.approve(call.name, body.sha256)
    return JsonAnswer(_recipe_status(call, changes))


@router.post(f"{_RECIPE_PATH}/rollback", response_model=_RecipeStatus)
def _roll_back(call: ByEngineer, name: Name, body: SeenRecipe) -> Response:
    """Restore the approved state with this hash."""
    changes = changes_of_existing(call, name)
    changes.roll_back(body.sha256)
    return JsonAnswer(_recipe_status(call, changes))


@router.post(f"{_RECIPE_PATH}/load", response_model=_Loaded)
def _load(call: ByEngineer, name: Name, body: LoadFields = _PRESENT) -> Response:
    """Judge later parts by the recipe: 200 after the parts in progress, 409 if it is refused."""
    try:
        return JsonAnswer({"running": vars(load_recipe(call, name, body.sha256))})
    except RecipeRefused as error:
        return JsonAnswer({"error": str(error), "kind": error.kind.name}, 409)


@router.post(f"{_RECIPE_PATH}/teach", status_code=202)
def _teach(call: ByEngineer, name: Name, body: TeachFields, response: Response) -> Job:
    """Start to teach parts: 202, 409 while a job is running."""
    response.headers["Location"] = _JOB_URL
    return start_teaching(
        call.panel,
        changes_of_new_or_existing(call, name),
        body.parts,
        body.texture,
        is_good=body.use == "good",
    )


@router.get(f"{_RECIPE_PATH}/challenge", response_model=_Challenge)
def _challenge(call: ByOperator, name: Name) -> dict[str, Any]:
    """The challenge set, and its last replay."""
    changes = changes_of_existing(call, name)
    state = changes.state
    return {
        "sets": challenge_sets(changes.files.challenge),
        "state": state.challenge,
        "has_met_challenge": state.has_met_challenge,
        "last_replay": state.replay,
    }


@router.post(f"{_RECIPE_PATH}/challenge", status_code=202)
def _replay(call: ByEngineer, name: Name, response: Response) -> Job:
    """Start a replay of the challenge set: 202, 409 while a job is running."""
    response.headers["Location"] = _JOB_URL
    return start_replay(call.panel, changes_of_existing(call, name))


@router.post(f"{_RECIPE_PATH}/challenge/parts", status_code=201, response_model=_Sets)
def _add_to_challenge(call: ByEngineer, name: Name, body: ChallengeFields) -> dict[str, Any]:
    """Add parts to the challenge set."""
    changes = changes_of_new_or_existing(call, name)
    add_parts_to_challenge(call.panel, changes, body.parts, body.expected)
    return {"sets": challenge_sets(changes.files.challenge)}


@router.delete(f"{_RECIPE_PATH}/challenge/parts/{{file}}", response_model=_Sets)
def _remove_from_challenge(call: ByEngineer, name: Name, file: str) -> dict[str, Any]:
    """Take a part out of the challenge set."""
    changes = changes_of_new_or_existing(call, name)
    changes.remove_from_challenge(file)
    return {"sets": challenge_sets(changes.files.challenge)}


@router.get("/job")
def _job(call: ByOperator) -> Job:
    """The running or last job."""
    job = call.panel.jobs.last
    if job is None:
        raise Denied(404, "no job was started in this run")
    return job


@router.delete("/job")
def _end_job(call: ByEngineer) -> Job:
    """End the running job."""
    call.panel.jobs.cancel(call.name)
    return _job(call)
