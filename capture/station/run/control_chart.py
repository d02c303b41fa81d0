"""Control charts of LED levels and distances: warn of a drift before parts fail."""

import math
import statistics
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import NormalDist

from capture.station.judge.judge import STOP_LED_LEVEL, relative_levels
from capture.station.results.part_result import PartResult
from capture.station.results.statistics import ChartedPart
from capture.station.run.events import PartAnnounced, RecipeLoaded, Warned
from capture.station.run.live_view import LiveEvent
from rig.acceptance import EQUAL_LED_LEVELS

_WARN_LED_LEVEL = 0.95
"""Level of an LED below which a warning names it.

It is relative to the brightest LED, as a share of the taught ratio.
"""
_MIN_LED_CHANGE = EQUAL_LED_LEVELS
"""Smaller differences from the baseline are no drift: sets are not corrected for them."""

# Subgroups of 4 or 5 and 20 to 25 of them for the limits are customary since Shewhart (1931).
GROUP, BASELINE_POINTS = 5, 20
"""Number of parts of one point, and of points of the baseline."""
# The mean range of two normal values is 1.128 standard deviations (ISO 7870-2, d2).
_RANGE_OF_TWO = 1.128
# Least standard deviation of a baseline, for values that hardly vary, as in a simulation. It is a
# share of a level or distance: levels are relative, and distances are logarithms.
_MIN_SIGMA = 1e-3
# Western Electric (Statistical Quality Control Handbook, 1956): number of last points, how many of
# them lie on one side of the baseline, and beyond how many standard deviations.
_RULES = ((1, 1, 3.0), (3, 2, 2.0), (5, 4, 1.0), (8, 8, 0.0))

_MAX_RULE_POINTS = max(points for points, _, _ in _RULES)


def baseline_of(values: Sequence[float]) -> NormalDist:
    """Return the distribution of a process in control, from two values or more."""
    # Sigma is the mean moving range over d2, which a slow drift does not raise.
    ranges = [abs(after - before) for before, after in pairwise(values)]
    sigma = statistics.fmean(ranges) / _RANGE_OF_TWO
    return NormalDist(statistics.fmean(values), max(sigma, _MIN_SIGMA))


def broken_rules(values: Sequence[float], baseline: NormalDist) -> tuple[str, ...]:
    """Return the Western Electric rules that the last value breaks, in words."""
    scores = [baseline.zscore(value) for value in values]
    broken = []
    for points, min_beyond, sigmas in _RULES:
        recent = scores[-points:]
        for sign, side in ((1.0, "above"), (-1.0, "below")):
            is_beyond = [sign * score > sigmas for score in recent]
            if len(recent) == points and is_beyond[-1] and sum(is_beyond) >= min_beyond:
                distance = f"{sigmas:g} standard deviations {side}" if sigmas else side
                broken.append(f"{min_beyond} of {points} points {distance} the baseline")
    return tuple(broken)


class _RepeatFilter:
    """Drops warnings that held at one of the last `_MAX_RULE_POINTS` points."""

    def __init__(self) -> None:
        self._points_since: dict[str, int] = {}  # points since each warning held last

    def new_warnings(self, warnings: Sequence[str]) -> tuple[str, ...]:
        """Return the new ones among the warnings that hold at the next point."""
        new = tuple(text for text in warnings if text not in self._points_since)
        later = {text: count + 1 for text, count in self._points_since.items()}
        recent = {text: count for text, count in later.items() if count < _MAX_RULE_POINTS}
        self._points_since = recent | dict.fromkeys(warnings, 0)
        return new


class _RuleSeries:
    """Points of one chart; the first `BASELINE_POINTS` of them give its baseline.

    A point that differs from the baseline by less than `min_change` breaks no rule.
    """

    def __init__(self, min_change: float = 0.0) -> None:
        self._min_change = min_change
        self._first: list[float] = []
        self.baseline: NormalDist | None = None
        self._recent: deque[float] = deque(maxlen=_MAX_RULE_POINTS)
        self._repeats = _RepeatFilter()

    def add(
        self, point: float, other_warnings: Iterable[str] = ()
    ) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Add a point; return the rules that it breaks, in words, and the new warnings.

        Warnings are `other_warnings`, which hold at the point, and the rules.
        """
        rules = self._rules_broken_by(point)
        return rules, self._repeats.new_warnings([*other_warnings, *rules])

    def _rules_broken_by(self, point: float) -> tuple[str, ...]:
        if self.baseline is not None:
            self._recent.append(point)
            if abs(point - self.baseline.mean) < self._min_change:
                return ()
            return broken_rules(list(self._recent), self.baseline)
        self._first.append(point)
        if len(self._first) == BASELINE_POINTS:
            self.baseline = baseline_of(self._first)
        return ()


class ControlChart:
    """Charts of a running station, which subscribe to its events and publish `Warned`.

    A warning is repeated only if it did not hold for eight points, a note only after eight parts
    without it.
    """

    def __init__(self, led_names: Sequence[str], publish: Callable[[Warned], None]) -> None:
        self._led_names, self._publish = tuple(led_names), publish
        self._begin()

    def _begin(self) -> None:
        self._levels = {name: _RuleSeries(_MIN_LED_CHANGE) for name in self._led_names}
        self._distance = _RuleSeries()
        self._repeated_notes = _RepeatFilter()
        self._group: list[PartResult] = []

    def __call__(self, live: LiveEvent) -> None:
        """Handle an event of the station: the result of a part, or another recipe."""
        if isinstance(live.event, RecipeLoaded):
            self._begin()
        elif isinstance(live.event, PartAnnounced):
            for text in self.add(live.event.result):
                self._publish(Warned(text))

    def add(self, result: PartResult) -> list[str]:
        """Add a result; return its new notes and the new warnings of the charts."""
        return [
            *self._repeated_notes.new_warnings(result.notes),
            *self._chart_warnings(result),
        ]

    def _chart_warnings(self, result: PartResult) -> list[str]:
        """Add a part to the present group; return the warnings of a full group."""
        if result.label is None or not _is_measured(
            result.distance, result.led_levels, len(self._led_names)
        ):
            return []
        self._group.append(result)
        if len(self._group) < GROUP:
            return []
        group, self._group = self._group, []
        return list(self._warnings_of(group))

    def _warnings_of(self, group: Sequence[PartResult]) -> Iterator[str]:
        low = (
            f"least {_WARN_LED_LEVEL:.0%}; parts become errors below {STOP_LED_LEVEL:.0%} of the "
            "brightest; clean or replace it"
        )
        levels = _relative_levels([result.led_levels for result in group])
        for level, (name, series) in zip(levels, self._levels.items(), strict=True):
            _, warnings = series.add(level, [low] if level < _WARN_LED_LEVEL else [])
            for text in warnings:
                yield f"{name} at {level:.1%} of its taught level: {text}"
        log_distance = _mean_log_distance(part.distance or 1.0 for part in group)
        _, warnings = self._distance.add(log_distance)
        for text in warnings:
            distance = math.exp(log_distance)
            yield f"distance {distance:.2f}: {text}; look at focus, light and material"


def _relative_levels(group: Sequence[Sequence[float]]) -> list[float]:
    """Return the mean level of each LED over some parts, as a share of the brightest."""
    means = [statistics.fmean(levels) for levels in zip(*group, strict=True)]
    return relative_levels(means)


def _mean_log_distance(distances: Iterable[float]) -> float:
    """Return the mean logarithm of distances, whose scatter is proportional to their size."""
    return statistics.fmean(map(math.log, distances))


def _is_measured(distance: float | None, led_levels: Sequence[float], leds: int) -> bool:
    """Whether a part has a distance, and the levels of `leds` LEDs, all finite and positive."""
    values = [*led_levels, distance or 0.0]
    return len(led_levels) == leds and all(math.isfinite(value) and value > 0.0 for value in values)


@dataclass(frozen=True)
class _ChartPoint:
    """A point of a chart: the mean of some parts, named after the last of them."""

    number: int
    part_id: str
    triggered_utc: str
    value: float  # arithmetic mean of levels, geometric mean of distances
    broken_rules: tuple[str, ...]  # Western Electric rules that the point breaks, in words
    new_rules: tuple[str, ...]  # the broken rules that a running station would report as new


@dataclass(frozen=True)
class ChartHistory:
    """The points of a control chart, and its limits."""

    points: tuple[_ChartPoint, ...]
    baseline_points: int  # number of first points
    centre: float | None
    # Three standard deviations from `centre`, as `upper`; None with too few points.
    lower: float | None
    upper: float | None


def chart_histories(parts: Iterable[ChartedPart]) -> tuple[ChartHistory, ...]:
    """Return the charts of the distance and of each LED, in order.

    Parts with another number of lights are left out.
    """
    listed = list(parts)
    leds = len(listed[-1].led_levels) if listed else 0
    measured = [part for part in listed if _is_measured(part.distance, part.led_levels, leds)]
    groups = [measured[end - GROUP : end] for end in range(GROUP, len(measured) + 1, GROUP)]
    levels = [_relative_levels([part.led_levels for part in group]) for group in groups]
    return (
        _history(
            groups,
            [_mean_log_distance(part.distance for part in group) for group in groups],
            math.exp,
        ),
        *(
            _history(groups, [point[led] for point in levels], min_change=_MIN_LED_CHANGE)
            for led in range(leds)
        ),
    )


def _history(
    groups: Sequence[Sequence[ChartedPart]],
    points: Sequence[float],
    value_of: Callable[[float], float] = lambda point: point,
    min_change: float = 0.0,
) -> ChartHistory:
    """Apply the rules to points of groups; `value_of` converts a point to chart units."""
    series, chart_points = _RuleSeries(min_change), []
    for (*_, last), point in zip(groups, points, strict=True):
        rules, new_rules = series.add(point)
        chart_points.append(
            _ChartPoint(
                last.number, last.part_id, last.triggered_utc, value_of(point),
                broken_rules=rules, new_rules=new_rules,
            )
        )  # fmt: skip
    if series.baseline is None:
        return ChartHistory(tuple(chart_points), len(chart_points), None, None, None)
    mean, three_sigma = series.baseline.mean, 3.0 * series.baseline.stdev
    centre, lower, upper = map(value_of, (mean, mean - three_sigma, mean + three_sigma))
    return ChartHistory(tuple(chart_points), BASELINE_POINTS, centre, lower, upper)
