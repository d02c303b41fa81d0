"""Recipes by HTTP: state, settings, approval, roll back, teaching, challenge set."""

from dataclasses import asdict
from typing import Any

from starlette.responses import Response

from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import read_recipe
from capture.station.domain.recipe_folder import RecipeFolder
from capture.station.domain.roles import Role
from capture.station.domain.taught import read_taught
from capture.station.judge.approval import approved_states
from capture.station.judge.challenge_set import challenge_sets
from capture.station.judge.recipe_changes import RecipeChanges
from capture.station.judge.recipe_settings import SettingsRefused, dotted
from capture.station.panel.api import V1
from capture.station.panel.background_jobs import Job
from capture.station.panel.render import JsonAnswer
from capture.station.panel.routes import Call, PanelRoute
from capture.station.panel.security import Denied
from capture.station.run.triggers import RecipeRefused
from classify.base.errors import InputError

from .recipe_pages import changes_of, known_changes_of, load_recipe_of, recipe_names
from .recipe_work import add_parts_to_challenge, start_replay, start_teaching

_ONE = f"{V1}/recipes/{{name}}"
_SEEN = {"sha256": "hash of the recipe as it was seen"}


def _recipes(call: Call) -> Response:
    loaded = call.panel.live.snapshot().recipe
    return JsonAnswer(
        {
            "recipes": recipe_names(call),
            "configured": call.panel.folder.config.recipe,
            "running": None if loaded is None else vars(loaded),
        }
    )


def _recipe(call: Call) -> Response:
    return JsonAnswer(_state(call, known_changes_of(call)))


def _state(call: Call, changes: RecipeChanges) -> dict[str, Any]:
    state = changes.state
    loaded = call.panel.live.snapshot().recipe
    return _fields(state.recipe) | {
        "is_approved": state.recipe.is_approved,
        "problem": state.problem,
        "challenge": state.challenge,
        "has_met_challenge": state.has_met_challenge,
        "is_running": loaded is not None and loaded.sha256 == state.recipe.sha256,
        "least_found": _least_found(changes.files, state.recipe),
    }


def _least_found(files: RecipeFolder, recipe: Recipe) -> list[dict[str, Any]]:
    try:
        return read_taught(files.version(recipe.version).taught).least_found_fields
    except InputError:
        return []


def _fields(recipe: Recipe) -> dict[str, Any]:
    return recipe.model_dump(mode="json", by_alias=True) | {"sha256": recipe.sha256}


def _versions(call: Call) -> Response:
    files = known_changes_of(call).files
    return JsonAnswer(
        {
            "present": read_recipe(files.file).sha256,
            "approved": [_fields(each) for each in approved_states(files)],
            "taught": files.taught_versions(),
        }
    )


def _save(call: Call) -> Response:
    changes, values = known_changes_of(call), call.fields.get("settings")
    if not isinstance(values, dict):
        raise InputError("settings: must be an object")
    try:
        changes.save_settings(call.text("sha256"), values)
    except SettingsRefused as error:
        wrong = {dotted(place): message for place, message in error.messages.items()}
        return JsonAnswer({"error": str(error), "settings": wrong}, 400)
    return JsonAnswer(_state(call, changes))


def _approve(call: Call) -> Response:
    changes = known_changes_of(call)
    changes.approve(call.name, call.text("sha256"))
    return JsonAnswer(_state(call, changes))


def _roll_back(call: Call) -> Response:
    changes = known_changes_of(call)
    changes.roll_back(call.text("sha256"))
    return JsonAnswer(_state(call, changes))


def _load(call: Call) -> Response:
    try:
        return JsonAnswer({"running": vars(load_recipe_of(call))})
    except RecipeRefused as error:
        return JsonAnswer({"error": str(error), "kind": error.kind.name}, 409)


def _teach(call: Call) -> Response:
    use = call.text("use", "good")
    if use not in ("good", "bad"):
        raise InputError(f"use = {use[:20]!r}: give good or bad")
    part_ids, texture = _part_ids(call), call.text("texture", "")
    return _started(
        start_teaching(call.panel, changes_of(call), part_ids, texture, is_good=use == "good")
    )


def _part_ids(call: Call) -> list[str]:
    part_ids = call.fields.get("parts", [])
    if not (isinstance(part_ids, list) and all(isinstance(each, str) for each in part_ids)):
        raise InputError("parts: must be a list of part ids")
    return part_ids


def _started(job: Job) -> Response:
    return JsonAnswer(asdict(job), 202, {"Location": f"{V1}/job"})


def _challenge(call: Call) -> Response:
    changes = known_changes_of(call)
    state, files = changes.state, changes.files
    return JsonAnswer(
        {
            "sets": challenge_sets(files.challenge),
            "state": state.challenge,
            "has_met_challenge": state.has_met_challenge,
            "last_replay": None if state.replay is None else state.replay.model_dump(mode="json"),
        }
    )


def _replay(call: Call) -> Response:
    return _started(start_replay(call.panel, known_changes_of(call)))


def _add(call: Call) -> Response:
    changes = changes_of(call)
    add_parts_to_challenge(call.panel, changes, _part_ids(call), call.text("expected"))
    return JsonAnswer({"sets": challenge_sets(changes.files.challenge)}, 201)


def _remove(call: Call) -> Response:
    changes = changes_of(call)
    changes.remove_from_challenge(call.path["file"])
    return JsonAnswer({"sets": challenge_sets(changes.files.challenge)})


def _job(call: Call) -> Response:
    job = call.panel.jobs.last
    if job is None:
        raise Denied(404, "no job was started in this run")
    return JsonAnswer(asdict(job))


def _end(call: Call) -> Response:
    call.panel.jobs.cancel(call.name)
    return _job(call)


_PARTS, _PARTS_TYPE = {"parts": "ids of parts"}, {"parts": "array"}
ROUTES = (
    PanelRoute(
        "GET", f"{V1}/recipes", Role.OPERATOR, _recipes, "Names of the recipes, and which one runs."
    ),
    PanelRoute("GET", _ONE, Role.OPERATOR, _recipe, "One recipe, and what it lacks."),
    PanelRoute(
        "GET", f"{_ONE}/versions", Role.OPERATOR, _versions, "States of a recipe to go back to."
    ),
    PanelRoute(
        "POST", f"{_ONE}/settings", Role.ENGINEER, _save,
        "Change settings: a state that nobody approved. A wrong value is named in `settings`.",
        fields=_SEEN | {"settings": "each of its keys replaces the whole setting"},
        types={"settings": "object"},
    ),
    PanelRoute(
        "POST", f"{_ONE}/approve", Role.ENGINEER, _approve, "Approve a recipe.", fields=_SEEN
    ),
    PanelRoute(
        "POST", f"{_ONE}/rollback", Role.ENGINEER, _roll_back,
        "Go back to a state that was approved.", fields={"sha256": "its hash"},
    ),
    PanelRoute(
        "POST", f"{_ONE}/load", Role.ENGINEER, _load,
        "Judge by the recipe from now on: 200 after the parts in progress, 409 with the reason.",
        fields={"sha256": "hash of the recipe as it was seen; without it, the present one"},
    ),
    PanelRoute(
        "POST", f"{_ONE}/teach", Role.ENGINEER, _teach,
        "Start to teach parts, without any the known ones again: 202, 409 while a job is running.",
        fields=_PARTS | {"texture": "their texture", "use": "good or bad"}, types=_PARTS_TYPE,
    ),
    PanelRoute(
        "GET", f"{_ONE}/challenge", Role.OPERATOR, _challenge,
        "The challenge set, and its last replay.",
    ),
    PanelRoute(
        "POST", f"{_ONE}/challenge", Role.ENGINEER, _replay,
        "Start a replay of the challenge set: 202, 409 while a job is running.",
    ),
    PanelRoute(
        "POST", f"{_ONE}/challenge/parts", Role.ENGINEER, _add, "Add parts to the challenge set.",
        fields=_PARTS | {"expected": "reject (any but PASS), PASS, FAIL or UNKNOWN"},
        types=_PARTS_TYPE,
    ),
    PanelRoute(
        "DELETE", f"{_ONE}/challenge/parts/{{file}}", Role.ENGINEER, _remove,
        "Take a part out of the challenge set.",
    ),
    PanelRoute("GET", f"{V1}/job", Role.OPERATOR, _job, "The running or last job."),
    PanelRoute("DELETE", f"{V1}/job", Role.ENGINEER, _end, "End the running job."),
)  # fmt: skip
