"""Charts of the statistics: yield, causes (Pareto), control charts, gauge study."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from typing import TYPE_CHECKING

from capture.base.chart import CHART_WIDTH_IN, LETTERS_PT, chart_axes, png_of, svg_uri
from capture.station.domain.verdict import Decision
from capture.station.judge.gauge import ACCEPTABLE, GaugeReport
from capture.station.results.statistics import CauseCount, Period
from capture.station.run.control_chart import ChartHistory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_SHARES = 10
"""Number of bars that have room for the share that passed above them."""
# Names of periods and numbers of parts that fit side by side below a chart.
_MAX_NAMES = 6
_HEIGHT_IN, _ROW_IN, _HEADING_IN = 2.6, 0.2, 0.42
_LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN = 0.75, 0.15, 0.28, 0.45
# Widths for the longest name of a cause or a measure, and for a count with its share.
_NAMES_IN, _NUMBERS_IN = 1.3, 0.8
_PNG_WIDTH_PX = 960
# Colours of `static/panel.css` for a light room; for a dark room `statistics.css` inverts them.
_BLUE, _GREY, _ALARM, _LIMIT = "#0b5cad", "#55606b", "#b23c00", "#8a5a00"
_DECISION_COLOURS = {
    Decision.PASS: "#00684a",
    Decision.FAIL: _ALARM,
    Decision.UNKNOWN: "#6b4e00",
    Decision.ERROR: "#8a1c6b",
}


@dataclass(frozen=True)
class Chart:
    """A chart that is drawn when it is shown."""

    description: str  # what it shows, in a sentence, for screen readers
    draw: Callable[[Axes], None]
    rows: int | None = None  # number of horizontal bars, each of which has a name and a number

    def svg(self) -> str:
        """Return the address of the chart as an SVG image with a transparent background."""
        return svg_uri(self._figure(()))

    def png(self, *heading: str) -> bytes:
        """Return the chart as a PNG file, under two lines of heading."""
        return png_of(self._figure(heading), _PNG_WIDTH_PX / CHART_WIDTH_IN)

    def _figure(self, heading: Sequence[str]) -> Figure:
        is_rows, top_in = self.rows is not None, _TOP_IN + _HEADING_IN * bool(heading)
        inside_in = _HEIGHT_IN - _TOP_IN - _BOTTOM_IN if self.rows is None else _ROW_IN * self.rows
        margins_in = (
            _NAMES_IN if is_rows else _LEFT_IN,
            _NUMBERS_IN if is_rows else _RIGHT_IN,
            top_in,
            _BOTTOM_IN,
        )
        height_in = inside_in + top_in + _BOTTOM_IN
        figure, axes = chart_axes(height_in, margins_in=margins_in)
        axes.spines[["left", "top", "right"]].set_visible(False)
        for spot in (figure, axes):
            spot.patch.set_visible(bool(heading))  # a page has its own background
        for number, (text, weight) in enumerate(zip(heading, ("bold", "normal"), strict=False)):
            y = 1.0 - (0.1 + 0.2 * number) / height_in
            figure.text(0.02, y, text, va="top", weight=weight, fontsize=LETTERS_PT)
        self.draw(axes)
        return figure


def yield_chart(periods: Sequence[Period]) -> Chart:
    """Draw numbers of parts by verdict, a bar for each period."""
    return Chart("Parts of each period by verdict", partial(_draw_yield, periods=periods))


def _draw_yield(axes: Axes, periods: Sequence[Period]) -> None:
    count = len(periods)
    width, heights = min(0.8, 0.14 * count), [0] * count
    for decision, colour in _DECISION_COLOURS.items():
        parts = [period.verdicts.get(decision, 0) for period in periods]
        axes.bar(range(count), parts, width, heights, color=colour, label=str(decision))
        heights = [height + added for height, added in zip(heights, parts, strict=True)]
    if count <= MAX_SHARES:
        for x, period in enumerate(periods):
            share = f"{period.verdicts.get(Decision.PASS, 0) / period.parts:.0%}"
            axes.text(x, period.parts, share, ha="center", va="bottom", fontsize=LETTERS_PT)
    axes.set_ylim(0.0, 1.08 * max(heights))
    axes.locator_params(axis="y", nbins=5, integer=True)  # no halves of parts
    axes.set_xlim(-0.5, count - 0.5)
    axes.grid(visible=False, axis="x")
    _name_below(axes, [_short(period.begin) for period in periods])
    _legend_above(axes)


def _name_below(axes: Axes, names: Sequence[str]) -> None:
    """Label x = 0, 1, 2 ... with at most `_MAX_NAMES` of the names."""
    positions = range(0, len(names), -(-len(names) // _MAX_NAMES))
    axes.set_xticks(positions, [names[x] for x in positions])


def _legend_above(axes: Axes) -> None:
    axes.legend(
        loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=4, frameon=False, borderaxespad=0.1,
        fontsize=LETTERS_PT, handlelength=1.0, columnspacing=1.2,
    )  # fmt: skip


def _short(period: str) -> str:
    """Return a period without its year: an hour as ``22, 17h``, a day as ``11-22``."""
    if len(period) == len("2026-11-22T17"):
        return f"{period[8:10]}, {period[11:]}h"
    return period[5:] if len(period) == len("2026-11-22") else period


def causes_chart(causes: Sequence[CauseCount], title: str) -> Chart:
    """Draw the share of each cause or kind of defect, the largest on top, and their sum."""
    description = f"{title} of parts that did not pass, and their cumulative share"
    return Chart(description, partial(_draw_causes, causes=causes), len(causes))


def _draw_causes(axes: Axes, causes: Sequence[CauseCount]) -> None:
    parts = [cause.parts for cause in causes]
    shares = [count / sum(parts) for count in parts]
    axes.barh(range(len(causes)), shares, 0.7, color=_BLUE)
    axes.plot([*accumulate(shares)], range(len(causes)), ".:", color=_GREY, clip_on=False)
    numbers = [f"{count} ({share:.0%})" for count, share in zip(parts, shares, strict=True)]
    _label_rows(axes, [cause.cause for cause in causes], numbers)


def _label_rows(axes: Axes, names: Sequence[str], numbers: Sequence[str]) -> None:
    """Put names before and numbers behind horizontal bars of shares, the first on top."""
    from matplotlib.ticker import PercentFormatter

    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.set_xlim(0.0, 1.0)
    axes.xaxis.set_major_formatter(PercentFormatter(1.0, symbol=" %"))
    for row, text in enumerate(numbers):
        axes.text(1.04, row, text, va="center", fontsize=LETTERS_PT)


def control_chart(history: ChartHistory, description: str, *, is_share: bool) -> Chart:
    """Draw points, mean and limits of the baseline, and points that break a rule."""
    return Chart(description, partial(_draw_control, history=history, is_share=is_share))


def _draw_control(axes: Axes, history: ChartHistory, is_share: bool) -> None:
    from matplotlib.ticker import PercentFormatter

    points, base = history.points, history.baseline_points - 0.5
    axes.axvspan(-0.5, base, color=_GREY, alpha=0.2, linewidth=0)
    axes.text(0.0, 1.02, "baseline", transform=axes.transAxes, fontsize=LETTERS_PT)
    levels = ((history.centre, _GREY, "-"), (history.lower, _LIMIT, "--"),
              (history.upper, _LIMIT, "--"))  # fmt: skip
    for value, colour, style in levels:
        if value is not None:
            axes.axhline(value, color=colour, linestyle=style, linewidth=1.2)
    axes.plot([point.value for point in points], color=_BLUE, linewidth=1.2)
    broken = [(x, point.value) for x, point in enumerate(points) if point.broken_rules]
    if broken:
        axes.plot(*zip(*broken, strict=True), "o", color=_ALARM, markersize=4)
    axes.set_xlim(-0.5, max(len(points), 2) - 0.5)
    axes.grid(visible=False, axis="x")
    _name_below(axes, [str(point.number) for point in points])
    axes.set_xlabel("part", labelpad=0)
    axes.locator_params(axis="y", nbins=5)
    if is_share:
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, symbol=" %"))
    else:
        axes.ticklabel_format(axis="y", useOffset=False)


def gauge_chart(report: GaugeReport) -> Chart:
    """Draw the three shares of a gauge study with their bounds and what is acceptable."""
    return Chart(
        f"Gauge study, {report.rating}: shares, bounds with 95 % confidence, acceptable values",
        partial(_draw_gauge, report=report),
        6,
    )


def _draw_gauge(axes: Axes, report: GaugeReport) -> None:
    rated = (report.effectiveness, report.misses, report.false_alarms)
    shares, bounds = [figure.share or 0.0 for figure in rated], [figure.bound for figure in rated]
    rows = range(len(rated))
    axes.barh(rows, shares, 0.5, color=_BLUE, label="found")
    axes.hlines(rows, shares, bounds, _GREY, ":", label="to its bound")
    axes.plot(ACCEPTABLE, rows, "|", color=_ALARM, ms=16, mew=2, label="acceptable", clip_on=False)
    numbers = [
        "no trials" if figure.share is None else f"{figure.events} of {figure.trials}"
        for figure in rated
    ]
    _label_rows(axes, ["effectiveness", "misses", "false alarms"], numbers)
    _legend_above(axes)
