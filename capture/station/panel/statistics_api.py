"""Statistics under ``/api/v1``: as JSON, and each figure as CSV and PNG."""

from typing import Annotated

from fastapi import APIRouter, Query
from starlette.responses import Response

from capture.base.outputs import csv_line

from .answers import answer, media
from .api import Numbers
from .filters import StatisticsFilters
from .guard import V1, ByOperator, Call, Turn
from .render import JsonAnswer
from .security import Denied
from .statistics import Figure, StationStatistics, statistics_of

router = APIRouter(prefix=f"{V1}/statistics")
_Figure = answer("Figure", title=str, note=str, rows=list[dict[str, str | int | float | None]])
_Statistics = answer(
    "Statistics",
    Numbers,
    station=str,
    shown=str,
    figures=dict[str, _Figure],  # type: ignore[valid-type]
)
_Selected = Annotated[StatisticsFilters, Query()]


@router.get("", response_model=_Statistics)
def _statistics(call: ByOperator, _: Turn, filters: _Selected) -> Response:
    """Yield, causes, kinds of defects, control charts and gauge study."""
    statistics = statistics_of(call.panel, filters.selection)
    return JsonAnswer(
        {
            "station": call.panel.folder.config.name,
            "shown": statistics.origin,
            **vars(statistics.tally),
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


@router.get("/{name}.csv", **media("text/csv"))
def _statistics_csv(call: ByOperator, _: Turn, name: str, filters: _Selected) -> Response:
    """A figure of the statistics: yield, causes, defects, distance, led-1 and so on, gauge."""
    figure = _figure(call, name, filters)[1]
    text = "".join(map(csv_line, (figure.columns, *figure.rows)))
    return Response(text, media_type="text/csv", headers=_file_name(call, f"{name}.csv"))


@router.get("/{name}.png", **media("image/png"))
def _statistics_png(call: ByOperator, _: Turn, name: str, filters: _Selected) -> Response:
    """The same as an image."""
    statistics, figure = _figure(call, name, filters)
    selected = statistics.selection
    bounds = (("from", selected.since_utc), ("to", selected.until_utc),
              ("texture", selected.label), ("recipe", selected.recipe))  # fmt: skip
    below = [
        "SIMULATED" if selected.simulated else "production", f"{statistics.tally.parts} parts",
        *(f"{name} {value}" for name, value in bounds if value is not None),
    ]  # fmt: skip
    heading = f"{call.panel.folder.config.name}: {figure.title}"
    content = figure.chart.png(heading, ", ".join(below))
    return Response(content, media_type="image/png", headers=_file_name(call, f"{name}.png"))


def _figure(call: Call, name: str, filters: StatisticsFilters) -> tuple[StationStatistics, Figure]:
    statistics = statistics_of(call.panel, filters.selection)
    if name not in statistics.figures:
        there = ", ".join(statistics.figures) or "none"
        raise Denied(404, f"figure {name[:100]}: not among those of the selected parts: {there}")
    return statistics, statistics.figures[name]


def _file_name(call: Call, name: str) -> dict[str, str]:
    station = call.panel.folder.config.name
    return {"Content-Disposition": f'attachment; filename="{station}-{name}"'}
