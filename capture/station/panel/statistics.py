"""Statistics of selected parts: the same numbers for the page, the API, CSV and PNG."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from capture.base.utc_time import local_zone
from capture.station.domain.folder import StationFolder, first_recipe
from capture.station.domain.verdict import Decision
from capture.station.judge.gauge import ACCEPTABLE, GaugeReport, read_gauge_report
from capture.station.results.history import Selection, Tally
from capture.station.results.statistics import (
    MAX_MEASURED,
    CauseCount,
    Period,
    count_parts,
    counted_causes,
    counted_defects,
    counted_periods,
    newest_measured,
)
from capture.station.run.control_chart import BASELINE_POINTS, GROUP, ChartHistory, chart_histories
from classify.base.errors import InputError
from rig.config.lights import led_names

from .charts import MAX_SHARES, Chart, causes_chart, control_chart, gauge_chart, yield_chart
from .panel import Panel

_Cell = str | int | float | None


@dataclass(frozen=True)
class Figure:
    """A chart and its numbers."""

    name: str  # for addresses and files
    title: str
    note: str  # how to read it
    columns: tuple[str, ...]
    rows: tuple[tuple[_Cell, ...], ...]
    chart: Chart
    remarks: tuple[str, ...] = ()  # points that stand out, one fact each


@dataclass(frozen=True)
class StationStatistics:
    """Statistics of selected parts, either of production or of a simulated rig."""

    selection: Selection
    tally: Tally
    figures: dict[str, Figure]  # by their names; those without numbers are left out

    @property
    def origin(self) -> str:
        """Origin of the parts: ``production`` or ``simulated``."""
        return "simulated" if self.selection.simulated else "production"


def statistics_of(panel: Panel, selection: Selection) -> StationStatistics:
    """Return the statistics of the selected parts, by hours and days of the station's clock."""
    store = panel.results.store
    counters, groups = count_parts(store, selection)
    tally = counters.simulated if selection.simulated else counters.production
    # Of the distance, then of each LED.
    charts = chart_histories(newest_measured(store, selection))
    figures = (
        *_yield_figure(counted_periods(groups)),
        *_pareto_figure(
            "causes",
            "Causes",
            "Parts that the station did not pass, by their gravest cause. A part that is like no "
            "texture counts under its next cause, if it has one; also: parts that have the cause "
            "beside a graver one. Overrides change nothing here.",
            counted_causes(groups),
        ),
        *_pareto_figure(
            "defects",
            "Kinds of defects",
            "The kind of the first defect of each part that did not pass and has one.",
            counted_defects(store, selection),
        ),
        *_control_figures(charts, _names_of_leds(panel.folder, len(charts) - 1)),
        *_gauge_figure(gauge_of(panel.folder, selection)),
    )
    return StationStatistics(selection, tally, {figure.name: figure for figure in figures})


def _names_of_leds(folder: StationFolder, leds: int) -> Sequence[str]:
    """Return LED names as in warnings, or numbers if the rig now has another number of LEDs."""
    try:
        tilts_deg = folder.rig_config().lights.tilts_deg
    except InputError:
        tilts_deg = ()
    if len(tilts_deg) == leds:
        return led_names(tilts_deg)
    return [f"LED {led}" for led in range(leds)]


def gauge_of(folder: StationFolder, selection: Selection) -> GaugeReport | None:
    """Return the gauge study of the selected recipe, or of the recipe of the next run."""
    try:
        files = folder.recipe_files(selection.recipe or first_recipe(folder))
    except InputError:
        return None  # no recipe has such a name, or the file of the last one is damaged
    report = read_gauge_report(files.gauge)
    return report if report is None or report.simulated == selection.simulated else None


def _yield_figure(periods: Sequence[Period]) -> Iterator[Figure]:
    if not periods:
        return
    rows: tuple[tuple[_Cell, ...], ...] = tuple(
        (
            period.begin,
            period.parts,
            *(period.verdicts.get(decision, 0) for decision in Decision),
            period.verdicts.get(Decision.PASS, 0) / period.parts,
        )
        for period in periods
    )
    yield Figure(
        "yield",
        "Yield",
        f"Verdicts that hold, after overrides, on the station's clock ({local_zone()})."
        f"{' Above a bar: the share that passed.' if len(periods) <= MAX_SHARES else ''}",
        ("period", "parts", *Decision, "passed"),
        rows,
        yield_chart(periods),
    )


def _pareto_figure(
    name: str, title: str, note: str, causes: Sequence[CauseCount]
) -> Iterator[Figure]:
    if not causes:
        return
    total, cumulative = sum(cause.parts for cause in causes), 0
    rows: list[tuple[_Cell, ...]] = []
    for count in causes:
        cumulative += count.parts
        shares = (count.parts / total, cumulative / total)
        rows.append((str(count.cause), count.parts, count.after_graver, *shares))
    yield Figure(
        name,
        title,
        f"{note} The line adds up the shares.",
        ("cause", "parts", "also", "share", "cumulative_share"),
        tuple(rows),
        causes_chart(causes, title),
    )


def _control_figures(charts: Sequence[ChartHistory], names: Sequence[str]) -> Iterator[Figure]:
    if not charts[0].points:
        return
    titles = ("Distance", *(f"Level of {name}" for name in names))
    for number, (chart, title) in enumerate(zip(charts, titles, strict=True)):
        rows = tuple(
            (
                point.number, point.part_id, point.triggered_utc, point.value,
                chart.centre, chart.lower, chart.upper, "; ".join(point.broken_rules),
            )
            for point in chart.points
        )  # fmt: skip
        remarks = tuple(
            f"{point.part_id}: {'; '.join(point.new_rules)}"
            for point in chart.points
            if point.new_rules
        )
        yield Figure(
            f"led-{number}" if number else "distance",
            title,
            f"Each point is the mean of {GROUP} consecutive parts, of the last {MAX_MEASURED} that "
            f"matched a texture. The first {BASELINE_POINTS} points are the baseline. Marked "
            "points break a Western Electric rule; the list names the part at which this begins.",
            (
                "number", "part_id", "triggered_utc", "value", "centre", "lower_limit",
                "upper_limit", "broken_rules",
            ),
            rows,
            control_chart(chart, f"Control chart: {title}", is_share=number > 0),
            remarks,
        )  # fmt: skip


def _gauge_figure(report: GaugeReport | None) -> Iterator[Figure]:
    if report is None:
        return
    names = ("effectiveness", "misses", "false_alarms")
    shares = (report.effectiveness, report.misses, report.false_alarms)
    # The last line is the rating, a lack of parts, or the result of the last kind of made faults.
    conclusion = report.lines[-1]
    yield Figure(
        "gauge",
        f"Gauge study: {report.rating}",
        f"Recipe {report.recipe}, {report.utc[:10]}, {report.presentations} presentations"
        f"{' of parts of a simulated rig' if report.simulated else ''}. {conclusion}.",
        ("measure", "events", "trials", "share", "bound_95", "acceptable", "rating"),
        tuple(
            (
                name,
                share.events,
                share.trials,
                share.share,
                share.bound,
                acceptable,
                report.rating,
            )
            for name, share, acceptable in zip(names, shares, ACCEPTABLE, strict=True)
        ),
        gauge_chart(report),
        report.wrong,
    )
