"""Charts of the statistics: yield, causes (Pareto), control charts, gauge study."""

from collections.abc import Iterator, Sequence

from capture.station.domain.verdict import Decision
from capture.station.judge.gauge.gauge import ACCEPTABLE
from capture.station.judge.gauge.gauge_report import GaugeReport
from capture.station.results.statistics import CauseCount, Period
from capture.station.run.control_chart import ChartHistory

from .drawing import (
    BOTTOM,
    HEIGHT,
    LEFT,
    LINE_HEIGHT,
    RIGHT,
    TOP,
    WIDTH,
    Box,
    Dot,
    Drawing,
    Kind,
    Line,
    Scale,
    Words,
    bottom_line,
    left_axis,
    scale_around,
)

# Room for the longest name of a cause or a measure, and for a count with its share.
_NAMES, _NUMBERS = 110, 86
_ROW = 22
# Names of periods that fit side by side below the chart.
_MOST_NAMES = 6
MOST_SHARES = 10
"""Bars that are wide enough for the share that passed, above them."""

_Element = Line | Box | Dot | Words


def yield_chart(periods: Sequence[Period]) -> Drawing:
    """Draw numbers of parts by verdict, a bar for each period."""
    return Drawing("Parts of each period by verdict", tuple(_yield(periods)))


def _yield(periods: Sequence[Period]) -> Iterator[_Element]:
    yield from _legend(tuple(Decision))
    most = max(period.parts for period in periods)
    up = Scale(0.0, 1.08 * most, HEIGHT - BOTTOM, TOP)
    yield from left_axis(up, most=min(5, max(2, most)))  # no halves of parts
    step = (WIDTH - LEFT - RIGHT) / len(periods)
    width = min(0.8 * step, 60.0)
    for number, period in enumerate(periods):
        middle = LEFT + (number + 0.5) * step
        begin, below = middle - width / 2, 0
        for decision in Decision:
            parts = period.verdicts.get(decision, 0)
            if parts:
                top, bottom = up(below + parts), up(below)
                about = f"{period.begin}: {parts} {decision}"
                yield Box(_KINDS[decision], begin, top, width, bottom - top, about)
                below += parts
        if len(periods) <= MOST_SHARES:
            share = period.verdicts.get(Decision.PASS, 0) / period.parts
            yield Words(middle, up(below) - 4, f"{share:.0%}", "middle")
    yield bottom_line()
    yield from _names_below([period.begin for period in periods], step)


def _names_below(names: Sequence[str], step: float) -> Iterator[Words]:
    every = -(-len(names) // _MOST_NAMES)
    for number in range(0, len(names), every):
        text = _short(names[number])
        yield Words(LEFT + (number + 0.5) * step, HEIGHT - BOTTOM + 18, text, "middle")


def _short(period: str) -> str:
    """Return a period without its year: an hour as ``22, 17h``, a day as ``11-22``."""
    if len(period) == len("2026-11-22T17"):
        return f"{period[8:10]}, {period[11:]}h"
    return period[5:] if len(period) == len("2026-11-22") else period


_KINDS: dict[Decision, Kind] = {
    Decision.PASS: "PASS",
    Decision.FAIL: "FAIL",
    Decision.UNKNOWN: "UNKNOWN",
    Decision.ERROR: "ERROR",
}


def _legend(decisions: Sequence[Decision]) -> Iterator[_Element]:
    for number, decision in enumerate(decisions):
        x = LEFT + 100.0 * number
        yield Box(_KINDS[decision], x, 6, 12, 12)
        yield Words(x + 18, 16, decision)


def causes_chart(causes: Sequence[CauseCount], title: str) -> Drawing:
    """Draw the share of each cause or kind of defect, the largest on top, and their sum."""
    height = TOP + _ROW * len(causes) + BOTTOM
    return Drawing(
        f"{title} of parts that did not pass, and their cumulative share",
        tuple(_causes(causes, height)),
        height=height,
    )


def _causes(causes: Sequence[CauseCount], height: int) -> Iterator[_Element]:
    across = Scale(0.0, 100.0, LEFT + _NAMES - 20, WIDTH - _NUMBERS)
    yield from _percent_axis(across, height)
    total = sum(cause.parts for cause in causes)
    added, curve = 0, []
    for number, cause in enumerate(causes):
        y = float(TOP + _ROW * number)
        added += cause.parts
        end = across(100.0 * cause.parts / total)
        about = f"{cause.cause}: {cause.parts} parts, also in {cause.also}"
        yield Box("series", across(0.0), y + 3, end - across(0.0), _ROW - 6, about)
        yield Words(across(0.0) - 6, y + 16, cause.cause, "end")
        yield Words(WIDTH - _NUMBERS + 14, y + 16, f"{cause.parts} ({cause.parts / total:.0%})")
        curve.append((across(100.0 * added / total), y + _ROW / 2))
    yield Line("share", tuple(curve))
    for x, y in curve:
        yield Dot("share", x, y, 3)


def _percent_axis(across: Scale, height: int) -> Iterator[_Element]:
    for percent in (0, 20, 40, 60, 80, 100):
        x = across(percent)
        yield Line("grid", ((x, TOP), (x, height - BOTTOM)))
        yield Words(x, height - BOTTOM + LINE_HEIGHT, f"{percent} %", "middle")


def control_chart(history: ChartHistory, about: str, *, is_share: bool) -> Drawing:
    """Draw a control chart: points, mean and limits of the baseline, broken rules.

    Shares are shown in percent.
    """
    factor, unit = (100.0, " %") if is_share else (1.0, "")
    return Drawing(about, tuple(_control(history, factor, unit)))


def _control(history: ChartHistory, factor: float, unit: str) -> Iterator[_Element]:
    points = history.points
    levels: tuple[tuple[Kind, float | None], ...] = (
        ("centre", history.centre), ("limit", history.lower), ("limit", history.upper)
    )  # fmt: skip
    shown = [(kind, factor * value) for kind, value in levels if value is not None]
    values = [factor * point.value for point in points]
    up = scale_around([*values, *(value for _, value in shown)], HEIGHT - BOTTOM, TOP)
    across = Scale(-0.5, max(len(points), 2) - 0.5, LEFT, WIDTH - RIGHT)
    base = across(history.baseline_points - 0.5)
    yield Box("base", LEFT, TOP, base - LEFT, HEIGHT - BOTTOM - TOP, "baseline")
    yield Words(LEFT + 4, TOP - 8, "baseline")
    yield from left_axis(up, unit)
    for kind, value in shown:
        yield Line(kind, ((LEFT, up(value)), (WIDTH - RIGHT, up(value))))
    places = [(across(number), up(value)) for number, value in enumerate(values)]
    yield Line("series", tuple(places))
    for (x, y), point, value in zip(places, points, values, strict=True):
        if point.broken:
            about = f"{point.part_id}: {value:.4g}{unit}; {'; '.join(point.broken)}"
            yield Dot("alarm", x, y, 3.5, about)
    yield bottom_line()
    yield Words(LEFT - 24, HEIGHT - BOTTOM + 18, "part", "end")
    every = -(-len(points) // _MOST_NAMES)
    for number in range(0, len(points), every):
        y = HEIGHT - BOTTOM + 18
        yield Words(across(number), y, str(points[number].number), "middle")


def gauge_chart(report: GaugeReport) -> Drawing:
    """Draw the three shares of a gauge study with their bounds and what is acceptable."""
    height = TOP + 3 * 2 * _ROW + BOTTOM
    return Drawing(
        f"Gauge study, {report.rating}: shares, bounds with 95 % confidence, acceptable values",
        tuple(_gauge(report, height)),
        height=height,
    )


def _gauge(report: GaugeReport, height: int) -> Iterator[_Element]:
    across = Scale(0.0, 100.0, LEFT + _NAMES - 20, WIDTH - _NUMBERS)
    yield from _percent_axis(across, height)
    yield Box("series", across(0.0), 6, 12, 12)
    yield Words(across(0.0) + 18, 16, "found")
    yield Line("share", ((across(0.0) + 90, 12), (across(0.0) + 108, 12)))
    yield Words(across(0.0) + 114, 16, "to its bound")
    yield Box("alarm", across(0.0) + 232, 4, 3, 16)
    yield Words(across(0.0) + 242, 16, "acceptable")
    shares = (report.effectiveness, report.misses, report.false_alarms)
    names = ("effectiveness", "misses", "false alarms")
    for number, (name, rated, acceptable) in enumerate(zip(names, shares, ACCEPTABLE, strict=True)):
        y = TOP + 2 * _ROW * number
        share = 100.0 * (rated.share or 0.0)
        yield Box("series", across(0.0), y + 8, across(share) - across(0.0), _ROW)
        bound_y = y + 8 + _ROW / 2
        yield Line("share", ((across(share), bound_y), (across(100.0 * rated.bound), bound_y)))
        yield Box("alarm", across(100.0 * acceptable) - 1.5, y + 4, 3, _ROW + 8)
        yield Words(across(0.0) - 6, y + 24, name, "end")
        text = "no trials" if rated.share is None else f"{rated.events} of {rated.trials}"
        yield Words(WIDTH - _NUMBERS + 14, y + 24, text)
