"""The pages that show parts: that of the operator, the history, the statistics."""

from urllib.parse import urlencode

from starlette.responses import Response

from capture.station.domain.roles import Role
from capture.station.domain.verdict import Decision
from capture.station.results.statistics import choices
from classify.base.errors import InputError

from .api import PARTS, newest_parts
from .filters import FilterForm, selection_of
from .render import page
from .routes import Call, PanelRoute
from .statistics import statistics_of
from .statistics_api import statistics_selection

# Number of last remarks below a figure; its CSV has all.
_MOST_REMARKS = 10


def _operator(call: Call) -> Response:
    return page(call, "operator.html")


def _history(call: Call) -> Response:
    store = call.panel.results.store
    form = FilterForm.of(call, choices(store))
    try:
        selection = selection_of(form.values)
    except InputError as error:
        answer = page(call, "history.html", form=form, decisions=Decision, message=str(error))
        answer.status_code = 400
        return answer
    entries, below = newest_parts(call, selection, PARTS)
    counters = store.counters(selection)
    tallies = {"production": counters.production, "simulated": counters.simulated}
    if selection.simulated is not None:
        del tallies["production" if selection.simulated else "simulated"]
    older = "" if below is None else urlencode({**form.values, "below": below})
    return page(
        call, "history.html", form=form, decisions=Decision, message="", entries=entries,
        older=older, tallies=tallies,
    )  # fmt: skip


def _statistics(call: Call) -> Response:
    form = FilterForm.of(call, choices(call.panel.results.store))
    statistics, message = None, ""
    try:
        selection = statistics_selection(form.values)
    except InputError as error:
        message = str(error)
    else:
        statistics = statistics_of(call.panel, selection, zone=None)
    answer = page(
        call, "statistics.html", form=form, statistics=statistics, message=message,
        decisions=Decision, most_remarks=_MOST_REMARKS,
    )  # fmt: skip
    answer.status_code = 400 if message else 200
    return answer


ROUTES = (
    PanelRoute(
        "GET", "/", Role.OPERATOR, _operator, "The last verdict, and the state.",
        answer="text/html", menu="Station",
    ),
    PanelRoute(
        "GET", "/history", Role.OPERATOR, _history, "Parts that were judged.", answer="text/html",
        menu="History",
    ),
    PanelRoute(
        "GET", "/statistics", Role.OPERATOR, _statistics, "Yield, causes, drift, gauge study.",
        answer="text/html", menu="Statistics",
    ),
)  # fmt: skip
