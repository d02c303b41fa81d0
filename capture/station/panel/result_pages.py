"""Pages of results: the last one, the history, the statistics, and one part."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from urllib.parse import urlencode

from fastapi import APIRouter
from starlette.responses import RedirectResponse, Response

from capture.base.utc_time import local_time
from capture.station.domain.limits import ROWS, Limits, Side, distinct_texts, excess_text
from capture.station.domain.recipe import Recipe
from capture.station.domain.users import Role
from capture.station.domain.verdict import Cause, Decision
from capture.station.results.history import HistoryEntry, Selection
from capture.station.results.part_result import PartResult
from classify.base.errors import InputError
from classify.library.match import MIN_MARGIN
from classify.lighting import orientation_text

from .answers import page, slow_page
from .api import PARTS, Below, entry_of, newest_parts, override
from .filters import FilterForm, StatisticsFilters, selection_of
from .guard import ByEngineer, ByOperator, Call, Turn
from .judged_by import recipe_of
from .statistics import statistics_of

router = APIRouter(include_in_schema=False)
# Number of last remarks below a figure; its CSV has all.
_MAX_REMARKS = 10
_NOT_MEASURED = "not measured"


@router.get("/")
def _operator(call: ByOperator) -> Response:
    """The last verdict, and the state."""
    return page(call, "operator.html")


@router.get("/history")
def _history(call: ByOperator, below: Below = None) -> Response:
    """Parts that were judged."""
    form = FilterForm.of(call)
    try:
        selection = selection_of(form.values)
    except InputError as error:
        return page(call, "history.html", 400, form=form, decisions=Decision, message=str(error))
    entries, next_below = newest_parts(call.panel, selection, PARTS, below)
    counters = call.panel.results.store.counters(selection)
    tallies = {"production": counters.production, "simulated": counters.simulated}
    if selection.simulated is not None:
        del tallies["production" if selection.simulated else "simulated"]
    older = urlencode({**form.values, "below": next_below}) if next_below else ""
    return page(
        call, "history.html", form=form, decisions=Decision, message="", entries=entries,
        older=older, tallies=tallies,
    )  # fmt: skip


@router.get("/statistics")
def _statistics(call: ByOperator, _: Turn) -> Response:
    """Yield, causes, drift, gauge study."""
    form = FilterForm.of(call)
    statistics, message = None, ""
    try:
        selection = selection_of(form.values, StatisticsFilters)
    except InputError as error:
        message = str(error)
    else:
        statistics = statistics_of(call.panel, selection)
    return slow_page(
        call,
        "statistics.html",
        400 if message else 200,
        form=form,
        statistics=statistics,
        message=message,
        decisions=Decision,
        most_remarks=_MAX_REMARKS,
    )


@router.get("/parts/{part_id}")
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


@router.post("/parts/{part_id}/override")
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


@dataclass(frozen=True)
class _MeasuredNumber:
    """A line of the table."""

    name: str
    value: str
    limit: str = ""
    is_beyond: bool = False


def measured_numbers(result: PartResult, recipe: Recipe | None) -> Iterator[_MeasuredNumber]:
    """Yield the numbers of a part; without its recipe the only limit is that of the result."""
    texture = result.label or result.nearest or ""
    limits = Limits() if recipe is None else recipe.limits_for(texture)
    distances = [limit for limit in (result.limit, limits.distance) if limit is not None]
    to = f"distance to {result.nearest or 'the nearest texture'}"
    yield _number(to, result.distance, [("at most", min(distances))] if distances else [])
    margin_limit = max(MIN_MARGIN, limits.margin or 0.0)
    least: list[tuple[Side, float]] = [] if recipe is None else [("at least", margin_limit)]
    yield _number("margin to the next texture", result.margin, least)
    yield _orientation(result, recipe)
    for key, row in ROWS.items():
        if key not in ("distance", "margin"):
            value, limit = getattr(result, row.measure or key), getattr(limits, key)
            bounds = () if limit is None else tuple(row.bounds(limit))
            yield _number(row.label, value, bounds, row.format_spec)


def _number(
    name: str, value: float | None, bounds: Sequence[tuple[Side, float]], format_spec: str = ".2f"
) -> _MeasuredNumber:
    if value is None:
        limit = ", ".join(f"{side} {bound:{format_spec}}" for side, bound in bounds)
        return _MeasuredNumber(name, _NOT_MEASURED, limit)
    texts = [(side, *distinct_texts(value, bound, format_spec)) for side, bound in bounds]
    longest = max((text for _, text, _ in texts), key=len, default=f"{value:{format_spec}}")
    limit = ", ".join(f"{side} {bound}" for side, _, bound in texts)
    is_beyond = any(excess_text(value, side, bound, format_spec) for side, bound in bounds)
    return _MeasuredNumber(name, longest, limit, is_beyond)


def _orientation(result: PartResult, recipe: Recipe | None) -> _MeasuredNumber:
    degrees, period_deg = result.orientation_deg, result.orientation_period_deg or 180.0
    digits, limit = 1, ""
    rule = None if recipe is None else recipe.orientation
    if rule is not None and (tolerance_deg := rule.tolerance_deg) is not None:
        limit = f"{rule.reference_deg:g} ± {tolerance_deg:g}°"
        if degrees is not None:
            off_deg = rule.deviation_deg(degrees, period_deg)
            ends = [degrees - off_deg + side * tolerance_deg for side in (-1.0, 1.0)]
            text = max((distinct_texts(degrees, end, ".1f")[0] for end in ends), key=len)
            digits = len(text.partition(".")[2])
    is_beyond = Cause.ORIENTATION in result.verdict.causes
    if degrees is None:
        return _MeasuredNumber("orientation", _NOT_MEASURED, limit, is_beyond)
    value = f"{orientation_text(degrees, digits, period_deg)}°"
    return _MeasuredNumber(f"orientation, over {period_deg:g}°", value, limit, is_beyond)
