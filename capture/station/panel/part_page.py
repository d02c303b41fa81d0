"""The page of a part: pictures, numbers against limits, and the recipe that judged it."""

from collections.abc import Iterator

from fastapi import APIRouter
from starlette.responses import RedirectResponse, Response

from capture.base.utc_time import local_time
from capture.station.domain.recipe import Recipe
from capture.station.domain.roles import Role
from capture.station.results.history import HistoryEntry, Selection
from capture.station.results.part_result import PartResult
from classify.base.errors import InputError

from .api import entry_of, override
from .guard import ByEngineer, ByOperator, Call
from .part_numbers import measured_numbers
from .part_pictures.judged_by import recipe_of
from .render import page

router = APIRouter(prefix="/parts/{part_id}", include_in_schema=False)


@router.get("")
def _show(call: ByOperator, part_id: str) -> Response:
    """One part: pictures, numbers against limits, hashes, and why it got its verdict."""
    return _page(call, part_id)


def _page(call: Call, part_id: str, problem: str = "") -> Response:
    entry = entry_of(call.panel, part_id)
    recipe, recipe_note = _recipe(call, entry.result)
    return page(
        call,
        "part.html",
        400 if problem else 200,
        entry=entry,
        result=entry.result,
        numbers=measured_numbers(entry.result, recipe),
        recipe_note=recipe_note,
        facts=list(_facts(entry.result)),
        hashes=list(_hashes(entry.result)),
        previous=_neighbour(call, entry, entry.result.number),
        following=_neighbour(call, entry, entry.result.number + 2),
        may_override=call.someone.role.includes(Role.ENGINEER),
        problem=problem,
    )


@router.post("/override")
def _override_part(call: ByEngineer, part_id: str) -> Response:
    """Give a part another verdict, from its page."""
    try:
        override(call, part_id, call.text("decision"), call.text("reason"))
    except InputError as error:
        return _page(call, part_id, str(error))
    return RedirectResponse(f"/parts/{part_id}", 303)


def _neighbour(call: Call, entry: HistoryEntry, below_number: int) -> str | None:
    """The last part below a number, None if that is the part itself or there is none."""
    entries = call.panel.results.store.parts(Selection(below_number=below_number), newest=1)
    part_id = next((entry.result.part_id for entry in entries), None)
    return None if part_id == entry.result.part_id else part_id


def _recipe(call: Call, result: PartResult) -> tuple[Recipe | None, str]:
    try:
        return recipe_of(call.panel.folder, result), ""
    except InputError as error:
        return None, f"The limits are not known: {error}."


def _facts(result: PartResult) -> Iterator[tuple[str, str | None]]:
    yield "number", str(result.number)
    yield "triggered", f"{local_time(result.triggered_utc, 'seconds')} by {result.trigger}"
    yield "exposed", result.exposed_utc and local_time(result.exposed_utc, "seconds")
    yield "judged", local_time(result.decided_utc, "seconds")
    yield "operator", result.operator
    recipe = result.recipe and f"{result.recipe}, version {result.recipe_version}"
    yield "recipe", recipe
    yield "texture", result.label or (result.nearest and f"unknown, nearest {result.nearest}")
    levels = ", ".join(f"{level:.0%}" for level in result.led_levels)
    yield "LED levels, relative to the taught ones", levels or None
    times = ", ".join(f"{name} {ms:.0f}" for name, ms in result.timings_ms.items())
    yield "times in ms", times or None
    yield "notes", "; ".join(result.notes) or None
    yield "software", f"ps4rig {result.software_version}"


def _hashes(result: PartResult) -> Iterator[tuple[str, str | None]]:
    yield "pixels of the set", result.set_sha256
    yield "recipe", result.recipe_sha256
    yield "texture library", result.library_sha256
    yield "calibration", result.calibration_sha256
