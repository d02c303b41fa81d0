"""The page of statistics."""

from starlette.responses import Response

from capture.station.domain.roles import Role
from capture.station.domain.verdict import Decision
from capture.station.results.statistics import choices
from classify.base.errors import InputError

from .filter_form import FilterForm
from .render import page
from .routes import Call, PanelRoute
from .statistics import statistics_of
from .statistics_api import statistics_selection

# Number of last remarks below a figure; its CSV has all.
_MOST_REMARKS = 10


def _show(call: Call) -> Response:
    form = FilterForm.of(call, choices(call.panel.results.store))
    found, message = None, ""
    try:
        selection = statistics_selection(form.values)
    except InputError as error:
        message = str(error)
    else:
        found = statistics_of(call.panel, selection)
    answer = page(
        call, "statistics.html", form=form, statistics=found, message=message, decisions=Decision,
        most_remarks=_MOST_REMARKS,
    )  # fmt: skip
    answer.status_code = 400 if message else 200
    return answer


ROUTES = (
    PanelRoute(
        "GET", "/statistics", Role.OPERATOR, _show, "Yield, causes, drift, gauge study.",
        answer="text/html", menu="Statistics",
    ),
)  # fmt: skip
