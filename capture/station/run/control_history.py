"""Control charts of recorded parts, with the points and rules of `control_chart`."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from capture.station.results.statistics import ChartedPart

from .control_chart import (
    BASELINE_POINTS,
    GROUP,
    LEAST_LED_CHANGE,
    NewWarnings,
    RuleSeries,
    is_measured,
    mean_log_distance,
    relative_levels,
)


@dataclass(frozen=True)
class ChartPoint:
    """A point of a chart: the mean of some parts, of which the last one names it."""

    number: int
    part_id: str
    triggered_utc: str
    value: float  # arithmetic mean of levels, geometric mean of distances
    broken: tuple[str, ...]  # Western Electric rules that the point breaks, in words
    begun: tuple[str, ...]  # those that a running station would report as new at this point


@dataclass(frozen=True)
class ChartHistory:
    """A control chart."""

    points: tuple[ChartPoint, ...]
    baseline_points: int  # number of first points
    centre: float | None
    # Three standard deviations from `centre`, as `upper`; None with too few points.
    lower: float | None
    upper: float | None


def chart_histories(parts: Iterable[ChartedPart]) -> tuple[ChartHistory, ...]:
    """Return the chart of the distance and those of each LED, in the order of the lights.

    Parts with another number of lights than the last one are left out.
    """
    listed = list(parts)
    leds = len(listed[-1].led_levels) if listed else 0
    measured = [part for part in listed if is_measured(part.distance, part.led_levels, leds)]
    groups = [measured[end - GROUP : end] for end in range(GROUP, len(measured) + 1, GROUP)]
    levels = [relative_levels([part.led_levels for part in group]) for group in groups]
    return (
        _history(
            groups,
            [mean_log_distance(part.distance for part in group) for group in groups],
            math.exp,
        ),
        *(
            _history(groups, [point[led] for point in levels], least=LEAST_LED_CHANGE)
            for led in range(leds)
        ),
    )


def _history(
    groups: Sequence[Sequence[ChartedPart]],
    points: Sequence[float],
    value_of: Callable[[float], float] = lambda point: point,
    least: float = 0.0,
) -> ChartHistory:
    """Apply the rules to points of groups; `value_of` converts a point to chart units."""
    series, warnings, shown = RuleSeries(least), NewWarnings(), []
    for (*_, last), point in zip(groups, points, strict=True):
        broken = series.add(point)
        begun, value = warnings.begun(broken), value_of(point)
        shown.append(
            ChartPoint(last.number, last.part_id, last.triggered_utc, value, broken, begun)
        )
    if series.baseline is None:
        return ChartHistory(tuple(shown), len(shown), None, None, None)
    mean, three_sigma = series.baseline.mean, 3.0 * series.baseline.sigma
    centre, lower, upper = map(value_of, (mean, mean - three_sigma, mean + three_sigma))
    return ChartHistory(tuple(shown), BASELINE_POINTS, centre, lower, upper)
