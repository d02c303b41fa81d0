"""The pages that show parts: that of the operator, the history, the statistics."""

from urllib.parse import urlencode

from fastapi import APIRouter
from starlette.responses import Response

from capture.station.domain.verdict import Decision
from capture.station.results.statistics import choices
from classify.base.errors import InputError

from .api import PARTS, Below, newest_parts
from .filters import FilterForm, StatisticsFilters, selection_of
from .guard import ByOperator, Turn
from .render import page, slow_page
from .statistics import statistics_of

router = APIRouter(include_in_schema=False)
# Number of last remarks below a figure; its CSV has all.
_MAX_REMARKS = 10


@router.get("/")
def _operator(call: ByOperator) -> Response:
    """The last verdict, and the state."""
    return page(call, "operator.html")


@router.get("/history")
def _history(call: ByOperator, below: Below = None) -> Response:
    """Parts that were judged."""
    store = call.panel.results.store
    form = FilterForm.of(call, choices(store))
    try:
        selection = selection_of(form.values)
    except InputError as error:
        return page(call, "history.html", 400, form=form, decisions=Decision, message=str(error))
    entries, next_below = newest_parts(call.panel, selection, PARTS, below)
    counters = store.counters(selection)
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
    form = FilterForm.of(call, choices(call.panel.results.store))
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
