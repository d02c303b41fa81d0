"""Pages of recipes: state, settings, parts to teach, challenge set, versions, job."""

from collections.abc import Callable
from typing import Any

from starlette.responses import RedirectResponse, Response

from capture.station.domain.recipe_file import SUFFIX, read_recipe
from capture.station.domain.recipe_folder import RecipeFolder
from capture.station.domain.roles import Role
from capture.station.domain.taught import read_taught
from capture.station.domain.verdict import Decision
from capture.station.judge.approval import approved_states
from capture.station.judge.challenge_set import EXPECTED, challenge_sets
from capture.station.judge.recipe_changes import RecipeChanges
from capture.station.judge.recipe_settings import SettingsRefused
from capture.station.judge.recipe_state import RecipeState
from capture.station.panel.api import whole_number
from capture.station.panel.render import page
from capture.station.panel.routes import Call, PanelRoute
from capture.station.panel.security import Denied
from capture.station.results.database import ResultsUnavailable
from capture.station.results.history import HistoryEntry, Selection
from capture.station.run.events import RecipeLoaded
from capture.station.run.triggers import Asker
from classify.base.errors import InputError, Ps4rigError
from classify.base.regular_file import read_regular_file

from .recipe_form import RecipeForm, settings_of
from .recipe_work import add_parts_to_challenge, start_replay, start_teaching

# No more than the parts that may wait for pictures (`picture_maker.MOST_WAITING`).
_SHOWN_PARTS = 20
_MOST_REPORT_BYTES = 1 << 26
# The report has its style and its pictures in itself, and no script.
_REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
_CHOSEN = "part."


def changes_of(call: Call) -> RecipeChanges:
    """Return the recipe of the path, which may not exist yet, for changes by the user."""
    return _changes_of(call, call.path["name"])


def _changes_of(call: Call, name: str) -> RecipeChanges:
    folder = call.panel.folder
    return RecipeChanges(folder, call.panel.changes, call.someone, folder.recipe_files(name))


def known_changes_of(call: Call) -> RecipeChanges:
    """Return the recipe of the path, for changes by the user."""
    changes = changes_of(call)
    if not changes.files.file.is_file():
        raise Denied(404, f"recipe {changes.files.name}: no such recipe")
    return changes


def load_recipe_of(call: Call) -> RecipeLoaded:
    """Let the station judge by the recipe of the path; the station records the change."""
    who = call.someone
    asker = Asker(call.name, who.role, call.text("sha256", "") or None, who.via)
    return call.panel.live.load_recipe(known_changes_of(call).files.name, asker)


def recipe_names(call: Call) -> list[str]:
    """Return the names of all recipes of the station."""
    return sorted(path.stem for path in (call.panel.folder.path / "recipes").glob(f"*{SUFFIX}"))


def _list(call: Call) -> Response:
    new = call.query.get("new")
    if new is not None:
        name = call.panel.folder.recipe_files(new.strip()).name
        return RedirectResponse(f"/recipes/{name}/parts", 303)
    rows: list[tuple[str, RecipeState | None, str]] = []
    for name in recipe_names(call):
        try:
            rows.append((name, _changes_of(call, name).state, ""))
        except InputError as error:
            rows.append((name, None, str(error)))
    return page(
        call,
        "recipes.html",
        rows=rows,
        configured=call.panel.folder.config.recipe,
        is_engineer=_is_engineer(call),
    )


def _show(call: Call) -> Response:
    return _recipe_page(call)


def _recipe_page(call: Call, problem: str = "") -> Response:
    changes = known_changes_of(call)
    files, state = changes.files, changes.state
    outcomes = {} if state.replay is None else {each.file: each for each in state.replay.parts}
    challenge = challenge_sets(files.challenge)
    answer = page(
        call,
        "recipe.html",
        recipe=state.recipe,
        state=state,
        challenge=[(file, want, outcomes.get(file)) for file, want in challenge.items()],
        states=approved_states(files),
        reports=[n for n in files.taught_versions() if files.version(n).report.is_file()],
        job=call.panel.jobs.last,
        is_configured=files.name == call.panel.folder.config.recipe,
        is_engineer=_is_engineer(call),
        problem=problem,
    )
    answer.status_code = 400 if problem else 200
    return answer


def _parts(call: Call) -> Response:
    return _parts_page(call)


def _parts_page(call: Call, problem: str = "") -> Response:
    changes = changes_of(call)
    files = changes.files
    below = whole_number(call, "below", 1, 2**53) if "below" in call.query else None
    selection = Selection(below_number=below)
    entries = list(call.panel.results.store.parts(selection, newest=_SHOWN_PARTS))[::-1]
    taught, textures = _taught(files)
    chosen = _chosen_ids(call)
    usable = {entry.result.part_id for entry in entries if _is_usable(entry)}
    answer = page(
        call,
        "recipe_parts.html",
        name=files.name,
        entries=entries,
        usable=usable,
        is_newest=below is None,
        older=entries[-1].result.number if len(entries) == _SHOWN_PARTS else None,
        taught=taught,
        challenge=challenge_sets(files.challenge),
        textures=textures,
        expected=EXPECTED,
        texture=call.fields.get("texture", ""),
        wanted=call.fields.get("expected", ""),
        chosen=chosen,
        further=" ".join(part_id for part_id in chosen if part_id not in usable),
        problem=problem,
        is_known=files.file.is_file(),
    )
    answer.status_code = 400 if problem else 200
    return answer


def _is_usable(entry: HistoryEntry) -> bool:
    result = entry.result
    is_kept = result.set_file is not None and entry.set_removed_utc is None
    return is_kept and result.verdict.decision is not Decision.ERROR


def _chosen_ids(call: Call) -> list[str]:
    """Return the parts that are ticked, and those that are given by their id."""
    ticked = [name.removeprefix(_CHOSEN) for name in call.fields if name.startswith(_CHOSEN)]
    given = call.text("ids", call.query.get("ids", ""))
    return list(dict.fromkeys([*ticked, *given.replace(",", " ").split()]))


def _taught(files: RecipeFolder) -> tuple[dict[str, str], list[str]]:
    """Textures of taught sets by the hash of their pixels, and the names of textures."""
    try:
        recipe = read_recipe(files.file)
        taught = read_taught(files.version(recipe.version).taught)
    except InputError:
        return {}, []
    known = {
        each.pixels_sha256: texture
        for texture, about in taught.textures.items()
        for each in about.sets
    }
    return known, list(taught.textures)


def _use_parts(call: Call) -> Response:
    changes, use = changes_of(call), call.text("use", "")
    part_ids = _chosen_ids(call)
    try:
        if use == "look":
            return _parts_page(call)
        if use in ("good", "bad"):
            if not part_ids:
                raise InputError("choose a part")
            texture = call.text("texture", "").strip()
            start_teaching(call.panel, changes, part_ids, texture, is_good=use == "good")
        elif use == "again":
            start_teaching(call.panel, changes, [], "", is_good=True)
        elif use == "challenge":
            add_parts_to_challenge(call.panel, changes, part_ids, call.text("expected", ""))
            return RedirectResponse(f"/recipes/{changes.files.name}", 303)
        else:
            raise InputError(f"use = {use[:20]!r}: give good, bad, again, challenge or look")
    except ResultsUnavailable:
        raise
    except Ps4rigError as error:
        return _parts_page(call, str(error))
    return RedirectResponse("/job", 303)


def _settings(call: Call) -> Response:
    recipe = read_recipe(known_changes_of(call).files.file)
    return _settings_page(call, RecipeForm(recipe), recipe.name, recipe.sha256)


def _settings_page(
    call: Call, form: RecipeForm, name: str, sha256: str, problem: str = ""
) -> Response:
    sections = form.sections()
    answer = page(
        call,
        "recipe_settings.html",
        name=name,
        sha256=sha256,
        sections=sections,
        textures=form.textures(),
        problem="; ".join(filter(None, [problem, *form.other_messages()])),
        is_wrong=form.is_wrong,
    )
    answer.status_code = 400 if problem or form.is_wrong else 200
    return answer


def _save_settings(call: Call) -> Response:
    changes, seen = known_changes_of(call), call.text("sha256")
    recipe = read_recipe(changes.files.file)
    try:
        # A form of another state may have other textures under the names of its fields.
        changes.save_settings(seen, settings_of(recipe, call.fields))
    except SettingsRefused as error:
        form = RecipeForm(recipe, call.fields, error.messages)
        return _settings_page(call, form, recipe.name, seen)
    except ResultsUnavailable:
        raise
    except InputError as error:
        return _settings_page(call, RecipeForm(recipe), recipe.name, recipe.sha256, str(error))
    return RedirectResponse(f"/recipes/{recipe.name}", 303)


def _changed(change: Callable[[Call, RecipeChanges], Any]) -> Callable[[Call], Response]:
    """Return the handler of a form of the recipe's page, which shows errors on that page."""

    def handler(call: Call) -> Response:
        changes = known_changes_of(call)
        try:
            job = change(call, changes)
        except ResultsUnavailable:
            raise
        except Ps4rigError as error:
            return _recipe_page(call, str(error))
        return RedirectResponse("/job" if job else f"/recipes/{changes.files.name}", 303)

    return handler


def _approve(call: Call, changes: RecipeChanges) -> None:
    changes.approve(call.name, call.text("sha256"))


def _roll_back(call: Call, changes: RecipeChanges) -> None:
    changes.roll_back(call.text("sha256"))


def _load(call: Call, _: RecipeChanges) -> None:
    load_recipe_of(call)


def _challenge(call: Call, changes: RecipeChanges) -> Any:
    file = call.text("remove", "")
    return changes.remove_from_challenge(file) if file else start_replay(call.panel, changes)


def _report(call: Call) -> Response:
    changes, text = known_changes_of(call), call.path["version"]
    numbers = {str(n): n for n in changes.files.taught_versions()}
    if text not in numbers:
        raise Denied(404, f"recipe {changes.files.name}: there is no version {text[:20]!r}")
    path = changes.files.version(numbers[text]).report
    if not path.is_file():
        raise Denied(404, f"recipe {changes.files.name}, version {text}: there is no report")
    content = read_regular_file(path, _MOST_REPORT_BYTES)
    headers = {"Content-Security-Policy": _REPORT_POLICY}
    return Response(content, media_type="text/html; charset=utf-8", headers=headers)


def _job(call: Call) -> Response:
    return page(call, "job.html", job=call.panel.jobs.last, is_engineer=_is_engineer(call))


def _end_job(call: Call) -> Response:
    call.panel.jobs.cancel(call.name)
    return RedirectResponse("/job", 303)


def _is_engineer(call: Call) -> bool:
    return call.someone.role.includes(Role.ENGINEER)


_HTML = "text/html"
_NAME = "/recipes/{name}"
_SHA256 = {"sha256": "hash of the recipe as it was seen"}
ROUTES = (
    PanelRoute(
        "GET", "/recipes", Role.OPERATOR, _list, "All recipes, and which one runs.",
        query={"new": "name of a new recipe, to choose its parts"}, answer=_HTML, menu="Recipes",
    ),
    PanelRoute(
        "GET", _NAME, Role.OPERATOR, _show, "A recipe: state, challenge set, versions.",
        answer=_HTML,
    ),
    PanelRoute(
        "GET", f"{_NAME}/parts", Role.ENGINEER, _parts,
        "Choose parts to teach, or for the challenge set.",
        query={"below": "only parts with a lower number", "ids": "parts that are chosen already"},
        answer=_HTML,
    ),
    PanelRoute(
        "POST", f"{_NAME}/parts", Role.ENGINEER, _use_parts,
        "Teach chosen parts, or add them to the challenge set.",
        fields={
            "use": "good, bad, again, challenge, or look at other parts",
            "part.ID": "anything, for each chosen part",
            "ids": "further parts", "texture": "their texture",
            "expected": "the verdict that they must get",
        },
        answer=_HTML,
    ),
    PanelRoute(
        "GET", f"{_NAME}/settings", Role.ENGINEER, _settings, "The form of the settings.",
        answer=_HTML,
    ),
    PanelRoute(
        "POST", f"{_NAME}/settings", Role.ENGINEER, _save_settings,
        "Save the settings: a state that nobody approved.",
        fields=_SHA256 | {"...": "the fields of the form"}, answer=_HTML,
    ),
    PanelRoute(
        "POST", f"{_NAME}/approve", Role.ENGINEER, _changed(_approve), "Approve a recipe.",
        fields=_SHA256, answer=_HTML,
    ),
    PanelRoute(
        "POST", f"{_NAME}/rollback", Role.ENGINEER, _changed(_roll_back),
        "Go back to a state that was approved.", fields={"sha256": "its hash"}, answer=_HTML,
    ),
    PanelRoute(
        "POST", f"{_NAME}/load", Role.ENGINEER, _changed(_load),
        "Judge by an approved recipe from now on.", fields=_SHA256, answer=_HTML,
    ),
    PanelRoute(
        "POST", f"{_NAME}/challenge", Role.ENGINEER, _changed(_challenge),
        "Replay the challenge set, or take a part out of it.",
        fields={"remove": "file of the part"}, answer=_HTML,
    ),
    PanelRoute(
        "GET", f"{_NAME}/versions/{{version}}/teaching", Role.OPERATOR, _report,
        "What teaching found for a version.", answer=_HTML,
    ),
    PanelRoute(
        "GET", "/job", Role.OPERATOR, _job, "The running or last job, with its progress.",
        answer=_HTML,
    ),
    PanelRoute("POST", "/job/end", Role.ENGINEER, _end_job, "End the running job.", answer=_HTML),
)  # fmt: skip
