"""Statistics as JSON, each figure as CSV and PNG, and the figures of a run for Prometheus."""

from collections.abc import Iterator
from importlib.metadata import version
from typing import Annotated

from fastapi import APIRouter, Query
from starlette.responses import Response

from capture.base.outputs import csv_line
from capture.station.domain.verdict import Decision
from capture.station.run.events import State
from capture.station.run.station_state import StationState

from .answers import JsonAnswer, answer, media
from .api import Numbers
from .filters import StatisticsFilters
from .guard import V1, ByOperator, Call, Turn
from .security import Denied
from .statistics import Figure, StationStatistics, statistics_of

router = APIRouter(prefix=V1)
_Figure = answer("Figure", title=str, note=str, rows=list[dict[str, str | int | float | None]])
_Statistics = answer(
    "Statistics",
    Numbers,
    station=str,
    shown=str,
    figures=dict[str, _Figure],  # type: ignore[valid-type]
)
_Selected = Annotated[StatisticsFilters, Query()]
_PROMETHEUS = "text/plain; version=0.0.4; charset=utf-8"


@router.get("/statistics", response_model=_Statistics)
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


@router.get("/statistics/{name}.csv", **media("text/csv"))
def _statistics_csv(call: ByOperator, _: Turn, name: str, filters: _Selected) -> Response:
    """A figure of the statistics: yield, causes, defects, distance, led-1 and so on, gauge."""
    figure = _figure(call, name, filters)[1]
    text = "".join(map(csv_line, (figure.columns, *figure.rows)))
    return Response(text, media_type="text/csv", headers=_file_name(call, f"{name}.csv"))


@router.get("/statistics/{name}.png", **media("image/png"))
def _statistics_png(call: ByOperator, _: Turn, name: str, filters: _Selected) -> Response:
    """A figure of the statistics, as for its CSV, as an image."""
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


@router.get("/metrics", **media(_PROMETHEUS))
def _metrics(call: ByOperator) -> Response:
    """Figures of this run for Prometheus."""
    text = "".join(f"{line}\n" for line in _lines(call.panel.live.snapshot()))
    return Response(text, media_type=_PROMETHEUS)


def _lines(live: StationState) -> Iterator[str]:
    """Yield the figures of a snapshot; counters begin at 0 with each run."""
    yield from _family("info", "gauge", "The station and its software.")
    labels = f'station="{live.station}",version="{version("ps4rig")}"'
    yield f"ps4rig_info{{{labels}}} 1"
    yield from _family("simulated", "gauge", "1 if the rig is simulated.")
    yield f"ps4rig_simulated {int(live.simulated)}"
    if live.recipe is not None:
        yield from _family("recipe", "gauge", "1 for the recipe by which parts are judged.")
        name, number, sha256 = live.recipe.name, live.recipe.version, live.recipe.sha256
        yield f'ps4rig_recipe{{name="{name}",version="{number}",sha256="{sha256}"}} 1'
    yield from _family("state", "gauge", "1 for the present state.")
    for state in State:
        yield f'ps4rig_state{{state="{state}"}} {int(state is live.state)}'
    yield from _family("device_fault", "gauge", "1 for a device with a fault.")
    for device in live.devices:
        yield f'ps4rig_device_fault{{device="{device.name}"}} {int(device.status == "fault")}'
    yield from _family("parts_total", "counter", "Parts of this run by verdict of the station.")
    for decision in Decision:
        count = live.announced.get(decision, 0)
        yield f'ps4rig_parts_total{{verdict="{decision}"}} {count}'
    yield from _family("refused_triggers_total", "counter", "Triggers that were not served.")
    yield f"ps4rig_refused_triggers_total {live.refused}"
    yield from _family("subscribers", "gauge", "Browsers and programs that follow the events.")
    yield f"ps4rig_subscribers {live.subscribers}"
    yield from _family("latency_seconds", "summary", "From the exposure to the announcement.")
    yield f"ps4rig_latency_seconds_sum {live.total_latency_ms / 1e3:.6f}"
    yield f"ps4rig_latency_seconds_count {sum(live.announced.values())}"


def _family(name: str, kind: str, meaning: str) -> Iterator[str]:
    yield f"# HELP ps4rig_{name} {meaning}"
    yield f"# TYPE ps4rig_{name} {kind}"
