"""Pages of recipes: state, settings, parts to teach, challenge set, versions, job."""

from typing import Literal

from fastapi import APIRouter
from starlette.responses import RedirectResponse, Response

from capture.station.domain.folder import RECIPES
from capture.station.domain.recipe_file import SUFFIX, RecipeFolder, read_recipe
from capture.station.domain.taught import read_taught
from capture.station.domain.users import Role
from capture.station.domain.verdict import Decision
from capture.station.judge.approval import approved_states
from capture.station.judge.challenge_set import EXPECTED, challenge_sets
from capture.station.judge.recipe_changes import RecipeChanges
from capture.station.judge.recipe_settings import SettingsRefused
from capture.station.judge.recipe_state import RecipeState
from capture.station.panel.answers import Name, page
from capture.station.panel.api import Below
from capture.station.panel.guard import ByEngineer, ByOperator, Call
from capture.station.panel.security import Denied
from capture.station.results.history import HistoryEntry, Selection
from capture.station.run.events import RecipeLoaded
from capture.station.run.triggers import Asker
from classify.base.errors import InputError
from classify.base.regular_file import read_regular_file

from .recipe_form import RecipeForm, settings_of
from .recipe_work import add_parts_to_challenge, start_replay, start_teaching

# No more than the parts that may wait for pictures (`part_pictures.MAX_WAITING`).
_SHOWN_PARTS = 20
_MAX_REPORT_BYTES = 1 << 26
# The report has its style and its pictures in itself, and no script.
_REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
_CHOSEN_PREFIX = "part."


router = APIRouter(include_in_schema=False)
_NAME = "/recipes/{name}"


def changes_of_new_or_existing(call: Call, name: str) -> RecipeChanges:
    """Return a recipe, which may not exist yet, for changes by the user."""
    folder = call.panel.folder
    return RecipeChanges(folder, call.panel.results, call.someone, folder.recipe_files(name))


def changes_of_existing(call: Call, name: str) -> RecipeChanges:
    """Return a recipe for changes by the user; 404 if it does not exist."""
    changes = changes_of_new_or_existing(call, name)
    if not changes.files.file.is_file():
        raise Denied(404, f"recipe {changes.files.name}: no such recipe")
    return changes


def load_recipe(call: Call, name: str, sha256: str | None) -> RecipeLoaded:
    """Ask the station to judge by a recipe; the station records the change."""
    who = call.someone
    asker = Asker(call.name, who.role, sha256, who.via)
    return call.panel.live.load_recipe(changes_of_existing(call, name).files.name, asker)


def recipe_names(call: Call) -> list[str]:
    """Return the names of all recipes of the station."""
    return sorted(path.stem for path in (call.panel.folder.path / RECIPES).glob(f"*{SUFFIX}"))


@router.get("/recipes")
def _list(call: ByOperator, new: str | None = None) -> Response:
    """All recipes, and which one runs."""
    if new is not None:
        name = call.panel.folder.recipe_files(new.strip()).name
        return RedirectResponse(f"/recipes/{name}/parts", 303)
    rows: list[tuple[str, RecipeState | None, str]] = []
    for name in recipe_names(call):
        try:
            rows.append((name, changes_of_new_or_existing(call, name).state, ""))
        except InputError as error:
            rows.append((name, None, str(error)))
    return page(
        call,
        "recipes.html",
        rows=rows,
        configured=call.panel.folder.config.recipe,
        is_engineer=_is_engineer(call),
    )


@router.get(_NAME)
def _show(call: ByOperator, name: Name) -> Response:
    """A recipe: state, challenge set, versions."""
    return _recipe_page(call, name)


def _recipe_page(call: Call, name: str, problem: str = "") -> Response:
    changes = changes_of_existing(call, name)
    files, state = changes.files, changes.state
    outcomes = {} if state.replay is None else {part.file: part for part in state.replay.parts}
    challenge = challenge_sets(files.challenge)
    return page(
        call,
        "recipe.html",
        400 if problem else 200,
        recipe=state.recipe,
        state=state,
        challenge=[(file, expected, outcomes.get(file)) for file, expected in challenge.items()],
        states=approved_states(files),
        reports=[
            version
            for version in files.taught_versions()
            if files.version(version).report.is_file()
        ],
        job=call.panel.jobs.last,
        is_configured=files.name == call.panel.folder.config.recipe,
        is_engineer=_is_engineer(call),
        problem=problem,
    )


@router.get(f"{_NAME}/parts")
def _parts(call: ByEngineer, name: Name, below: Below = None) -> Response:
    """Choose parts to teach, or for the challenge set."""
    return _parts_page(call, name, below)


def _parts_page(call: Call, name: str, below: int | None, problem: str = "") -> Response:
    files = changes_of_new_or_existing(call, name).files
    selection = Selection(below_number=below)
    entries = list(call.panel.results.store.parts(selection, newest=_SHOWN_PARTS))[::-1]
    taught, textures = _taught(files)
    chosen = _chosen_ids(call)
    usable = {entry.result.part_id for entry in entries if _is_usable(entry)}
    return page(
        call,
        "recipe_parts.html",
        400 if problem else 200,
        name=files.name,
        entries=entries,
        usable=usable,
        is_newest=below is None,
        older=entries[-1].result.number if len(entries) == _SHOWN_PARTS else None,
        taught=taught,
        challenge=challenge_sets(files.challenge),
        textures=textures,
        verdicts=EXPECTED,
        texture=call.fields.get("texture", ""),
        expected=call.fields.get("expected", ""),
        chosen=chosen,
        further=" ".join(part_id for part_id in chosen if part_id not in usable),
        problem=problem,
        is_known=files.file.is_file(),
    )


def _is_usable(entry: HistoryEntry) -> bool:
    result = entry.result
    is_kept = result.set_file is not None and entry.set_removed_utc is None
    return is_kept and result.verdict.decision is not Decision.ERROR


def _chosen_ids(call: Call) -> list[str]:
    """Return the ids of the parts that are ticked, and the typed ids."""
    ticked = [
        name.removeprefix(_CHOSEN_PREFIX) for name in call.fields if name.startswith(_CHOSEN_PREFIX)
    ]
    typed = call.text("ids", call.request.query_params.get("ids", ""))
    return list(dict.fromkeys([*ticked, *typed.replace(",", " ").split()]))


def _taught(files: RecipeFolder) -> tuple[dict[str, str], list[str]]:
    """Textures of taught sets by the hash of their pixels, and the names of textures."""
    try:
        recipe = read_recipe(files.file)
        taught = read_taught(files.version(recipe.version).taught)
    except InputError:
        return {}, []
    known = {
        taught_set.pixels_sha256: texture
        for texture, texture_data in taught.textures.items()
        for taught_set in texture_data.sets
    }
    return known, list(taught.textures)


@router.post(f"{_NAME}/parts")
def _use_parts(call: ByEngineer, name: Name, below: Below = None) -> Response:
    """Teach chosen parts, or add them to the challenge set."""
    changes, use = changes_of_new_or_existing(call, name), call.text("use", "")
    part_ids = _chosen_ids(call)
    try:
        if use == "look":
            return _parts_page(call, name, below)
        if use in ("good", "bad"):
            if not part_ids:
                raise InputError("choose a part")
            texture = call.text("texture", "").strip()
            start_teaching(call.panel, changes, part_ids, texture, is_good=use == "good")
        elif use == "again":
            start_teaching(call.panel, changes, [], "", is_good=True)
        elif use == "challenge":
            text = call.text("expected", "")
            expected = next((verdict for verdict in EXPECTED if verdict == text), None)
            if expected is None:
                raise InputError(f"expected: give {', '.join(EXPECTED)}")
            add_parts_to_challenge(call.panel, changes, part_ids, expected)
            return RedirectResponse(f"/recipes/{changes.files.name}", 303)
        else:
            raise InputError(f"use = {use[:20]!r}: give good, bad, again, challenge or look")
    except InputError as error:
        return _parts_page(call, name, below, str(error))
    return RedirectResponse("/job", 303)


@router.get(f"{_NAME}/settings")
def _settings(call: ByEngineer, name: Name) -> Response:
    """The form of the settings."""
    recipe = read_recipe(changes_of_existing(call, name).files.file)
    return _settings_page(call, RecipeForm(recipe), recipe.name, recipe.sha256)


def _settings_page(
    call: Call, form: RecipeForm, name: str, sha256: str, problem: str = ""
) -> Response:
    sections = form.sections()
    return page(
        call,
        "recipe_settings.html",
        400 if problem or form.is_wrong else 200,
        name=name,
        sha256=sha256,
        sections=sections,
        textures=form.textures(),
        problem="; ".join(filter(None, [problem, *form.other_messages()])),
        is_wrong=form.is_wrong,
    )


@router.post(f"{_NAME}/settings")
def _save_settings_page(call: ByEngineer, name: Name) -> Response:
    """Save the settings; the changed recipe is not approved."""
    changes, shown_sha256 = changes_of_existing(call, name), call.text("sha256")
    recipe = read_recipe(changes.files.file)
    try:
        # A form of another state may have other textures under the names of its fields.
        changes.save_settings(shown_sha256, settings_of(recipe, call.fields))
    except SettingsRefused as error:
        form = RecipeForm(recipe, call.fields, error.messages)
        return _settings_page(call, form, recipe.name, shown_sha256)
    except InputError as error:
        return _settings_page(call, RecipeForm(recipe), recipe.name, recipe.sha256, str(error))
    return RedirectResponse(f"/recipes/{recipe.name}", 303)


@router.post(f"{_NAME}/{{action}}")
def _change(
    call: ByEngineer, name: Name, action: Literal["approve", "rollback", "load", "challenge"]
) -> Response:
    """Approve a recipe, go back to another state, load it, replay or change its challenge set."""
    changes, next_page = changes_of_existing(call, name), f"/recipes/{name}"
    sha256, removed = call.text("sha256", ""), call.text("remove", "")
    try:
        if action == "approve":
            changes.approve(call.name, sha256)
        elif action == "rollback":
            changes.roll_back(sha256)
        elif action == "load":
            load_recipe(call, name, sha256 or None)
        elif removed:
            changes.remove_from_challenge(removed)
        else:
            start_replay(call.panel, changes)
            next_page = "/job"
    except InputError as error:  # shown on the page of the recipe
        return _recipe_page(call, name, str(error))
    return RedirectResponse(next_page, 303)


@router.get(f"{_NAME}/versions/{{version}}/teaching")
def _report(call: ByOperator, name: Name, version: int) -> Response:
    """The report of teaching for a version."""
    files = changes_of_existing(call, name).files
    path = files.version(version).report
    if version not in files.taught_versions() or not path.is_file():
        raise Denied(404, f"recipe {name}, version {version}: there is no report")
    content = read_regular_file(path, _MAX_REPORT_BYTES)
    headers = {"Content-Security-Policy": _REPORT_POLICY}
    return Response(content, media_type="text/html; charset=utf-8", headers=headers)


@router.get("/job")
def _job_page(call: ByOperator) -> Response:
    """The running or last job, with its progress."""
    return page(call, "job.html", job=call.panel.jobs.last, is_engineer=_is_engineer(call))


@router.post("/job/end")
def _end_job_page(call: ByEngineer) -> Response:
    """End the running job."""
    call.panel.jobs.cancel(call.name)
    return RedirectResponse("/job", 303)


def _is_engineer(call: Call) -> bool:
    return call.someone.role.includes(Role.ENGINEER)
