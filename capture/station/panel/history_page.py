"""The page of the history: selected parts, the newest first."""

from urllib.parse import urlencode

from starlette.responses import Response

from capture.station.domain.roles import Role
from capture.station.domain.verdict import Decision
from capture.station.results.statistics import choices
from classify.base.errors import InputError

from .api import PARTS, newest_parts
from .filter_form import FilterForm
from .filters import selection_of
from .render import page
from .routes import Call, PanelRoute


def _show(call: Call) -> Response:
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


ROUTES = (
    PanelRoute(
        "GET", "/history", Role.OPERATOR, _show, "Parts that were judged.", answer="text/html",
        menu="History",
    ),
)  # fmt: skip
