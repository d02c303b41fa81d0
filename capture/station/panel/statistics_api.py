"""Statistics under ``/api/v1``: as JSON, and each figure as CSV and PNG."""

from collections.abc import Mapping

from starlette.responses import Response

from capture.base.outputs import csv_line
from capture.station.domain.roles import Role
from capture.station.results.history import Selection
from capture.station.results.history_table import tally_record
from classify.base.errors import InputError

from .api import V1
from .charts.chart_png import drawing_png
from .filters import FILTERS, OF_ONE_PART, selection_of
from .render import JsonAnswer
from .routes import Call, PanelRoute
from .security import Denied
from .statistics import Figure, StationStatistics, statistics_of

_FILTERS = {name: about for name, about in FILTERS.items() if name not in OF_ONE_PART} | {
    "simulated": "only: parts of a simulated rig; by default production"
}


def statistics_selection(query: Mapping[str, str]) -> Selection:
    """Return the parts that a query of statistics selects."""
    for name in OF_ONE_PART:
        if query.get(name):
            raise InputError(f"{name}: statistics have no such filter; leave it out")
    return selection_of(query)


def _statistics(call: Call) -> Response:
    statistics = statistics_of(call.panel, statistics_selection(call.query))
    return JsonAnswer(
        {
            "station": call.panel.folder.config.name,
            "shown": statistics.shown,
            **tally_record(statistics.tally),
            "figures": {
                name: {
                    "title": figure.title,
                    "note": figure.note,
                    "rows": [dict(zip(figure.columns, row, strict=True)) for row in figure.rows],
                }
                for name, figure in statistics.figures.items()
            },
        }
    )


def _figure(call: Call) -> tuple[StationStatistics, Figure]:
    name, statistics = (
        call.path["name"],
        statistics_of(call.panel, statistics_selection(call.query)),
    )
    if name not in statistics.figures:
        there = ", ".join(statistics.figures) or "none"
        raise Denied(404, f"figure {name[:100]}: not among those of the selected parts: {there}")
    return statistics, statistics.figures[name]


def _csv(call: Call) -> Response:
    _, figure = _figure(call)
    text = "".join(map(csv_line, (figure.columns, *figure.rows)))
    return _file(call, text, "text/csv; charset=utf-8", "csv")


def _png(call: Call) -> Response:
    statistics, figure = _figure(call)
    selected = statistics.selection
    bounds = (("from", selected.since_utc), ("to", selected.until_utc),
              ("texture", selected.label), ("recipe", selected.recipe))  # fmt: skip
    below = [
        "SIMULATED" if selected.simulated else "production", f"{statistics.tally.parts} parts",
        *(f"{name} {value}" for name, value in bounds if value is not None),
    ]  # fmt: skip
    heading = f"{call.panel.folder.config.name}: {figure.title}"
    return _file(call, drawing_png(figure.drawing, heading, ", ".join(below)), "image/png", "png")


def _file(call: Call, content: str | bytes, media_type: str, suffix: str) -> Response:
    name = f"{call.panel.folder.config.name}-{call.path['name']}.{suffix}"
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(content, media_type=media_type, headers=headers)


ROUTES = (
    PanelRoute(
        "GET", f"{V1}/statistics", Role.OPERATOR, _statistics,
        "Yield, causes, kinds of defects, control charts and gauge study.", query=_FILTERS,
    ),
    PanelRoute(
        "GET", f"{V1}/statistics/{{name}}.csv", Role.OPERATOR, _csv,
        "A figure of the statistics: yield, causes, defects, distance, led-1 and so on, gauge.",
        query=_FILTERS, answer="text/csv",
    ),
    PanelRoute(
        "GET", f"{V1}/statistics/{{name}}.png", Role.OPERATOR, _png,
        "The same as an image.", query=_FILTERS, answer="image/png",
    ),
)  # fmt: skip
