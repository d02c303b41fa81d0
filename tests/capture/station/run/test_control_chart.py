"""Tests of the control charts."""

from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest

from capture.station.domain.verdict import Decision, Verdict
from capture.station.results.part_result import PartResult
from capture.station.results.statistics import ChartedPart
from capture.station.run.control_chart import (
    BASELINE_POINTS,
    GROUP,
    ControlChart,
    baseline_of,
    broken_rules,
    chart_histories,
)
from capture.station.run.events import PartAnnounced, RecipeLoaded
from rig.config.lights import led_names
from tests.capture.station.results.many import many
from tests.capture.station.stations import published

BASELINE_PARTS = GROUP * BASELINE_POINTS

LEDS = tuple(led_names([0, 90, 180, 270]))
UNIT = NormalDist(0.0, 1.0)
PART = PartResult(
    station="s",
    part_id="1",
    number=1,
    trigger="timer",
    triggered_utc="2026-01-01T00:00:00.000Z",
    exposed_utc=None,
    decided_utc="2026-01-01T00:00:00.000Z",
    verdict=Verdict(Decision.PASS, "good"),
    operator=None,
    simulated=True,
    software_version="0",
    label="steel",
    distance=1.0,
    led_levels=(1.0, 1.0, 1.0, 1.0),
)


@pytest.mark.parametrize(
    ("values", "rules"),
    [
        ([0.0] * 7 + [3.1], ["1 of 1 points 3"]),
        ([0.0, 2.1, 0.0, -2.1], []),
        ([0.0, 2.1, 0.0, 2.1], ["2 of 3 points 2"]),
        ([-1.1, -1.1, 0.0, -1.1, -1.1], ["4 of 5 points 1"]),
        ([0.1] * 8, ["8 of 8 points above"]),
        ([0.1] * 7, []),
        ([0.1] * 7 + [-0.1], []),
    ],
)
def test_each_western_electric_rule_is_noticed(values: list[float], rules: list[str]) -> None:
    found = broken_rules(values, UNIT)
    assert len(found) == len(rules)
    assert all(each.startswith(rule) for each, rule in zip(found, rules, strict=True))


def test_a_process_in_control_breaks_a_rule_as_seldom_as_known() -> None:
    # Champ and Woodall (1987): with all four rules one point in 91.75.
    values = np.random.default_rng(1).standard_normal(20_000).tolist()
    runs, start = [], 0
    for end in range(1, len(values) + 1):
        if broken_rules(values[max(start, end - 8) : end], UNIT):
            runs.append(end - start)
            start = end
    assert np.mean(runs) == pytest.approx(91.75, rel=0.2)


def test_a_drift_does_not_widen_its_own_baseline() -> None:
    draw = np.random.default_rng(2)
    noise = draw.normal(0.0, 0.01, 200)
    assert baseline_of((1.0 + noise).tolist()).stdev == pytest.approx(0.01, rel=0.2)
    drifting = 1.0 + noise + np.linspace(0.0, 0.1, 200)
    assert baseline_of(drifting.tolist()).stdev == pytest.approx(0.01, rel=0.2)


def fed(levels: np.ndarray, distances: np.ndarray) -> list[str]:
    """Warnings of a chart that sees these parts."""
    told: list[str] = []

    chart = ControlChart(LEDS, lambda warned: told.append(warned.text))
    for level, distance in zip(levels.tolist(), distances.tolist(), strict=True):
        chart(
            *published(
                PartAnnounced(replace(PART, led_levels=tuple(level), distance=distance), 1.0)
            )
        )
    return told


def test_a_fading_led_is_named_long_before_its_parts_are_errors() -> None:
    draw, parts = np.random.default_rng(3), 600
    levels = 1.0 + draw.normal(0.0, 0.01, (parts, 4))
    # From the baseline on it loses 15 % in 500 parts.
    fading = np.clip(np.arange(parts) - BASELINE_PARTS, 0, None) / 500.0
    levels[:, 2] -= 0.15 * fading
    told = fed(levels, np.exp(draw.normal(0.0, 0.1, parts)))
    of_led = [text for text in told if text.startswith("LED 2 (tilt 180)")]
    level = float(of_led[0].split("at ")[1].split("%")[0])
    assert level > 96.0
    assert any("least 95%" in text for text in of_led)
    assert len(of_led) < 12


@pytest.mark.parametrize("distance", [1.0, 1.001, 2.0])
def test_parts_that_hardly_vary_break_a_rule_from_three_per_mille_on(distance: float) -> None:
    """The logarithm of a distance near 1 is near 0."""
    parts = BASELINE_PARTS + GROUP
    distances = np.full(parts, distance)
    distances[-GROUP:] *= 1.002
    assert fed(np.ones((parts, 4)), distances) == []
    distances[-GROUP:] *= 1.002
    assert len(fed(np.ones((parts, 4)), distances)) == 1


def test_another_recipe_begins_another_baseline() -> None:
    """Its distances and the levels at which it was taught are others."""
    draw, told = np.random.default_rng(5), list[str]()
    chart = ControlChart(LEDS, lambda warned: told.append(warned.text))

    def judge(logs: np.ndarray) -> None:
        for log in logs:
            chart(*published(PartAnnounced(replace(PART, distance=float(np.exp(log))), 1.0)))

    judge(draw.normal(0.0, 0.1, BASELINE_PARTS + 2))
    chart(*published(RecipeLoaded("other", 1, "0" * 64)))
    judge(draw.normal(0.4, 0.1, BASELINE_PARTS))
    assert told == []
    judge(draw.normal(0.55, 0.1, 100))
    assert any(text.startswith("distance") for text in told)


@pytest.mark.parametrize(("absent", "repeated"), [(7, []), (8, ["the clock was set"])])
def test_a_note_is_repeated_after_eight_parts_without_it(absent: int, repeated: list[str]) -> None:
    chart, noted = ControlChart(LEDS, print), replace(PART, notes=("the clock was set",))
    assert chart.add(noted) == ["the clock was set"]
    for _ in range(absent):
        assert chart.add(PART) == []
    assert chart.add(noted) == repeated


def test_parts_without_a_texture_are_on_no_chart() -> None:
    chart = ControlChart(LEDS, print)
    for changes in (
        {"label": None},
        {"led_levels": ()},
        {"distance": None},
        {"led_levels": (0.1, 0.1, 0.1, -0.1)},
    ):
        assert [chart.add(replace(PART, **changes)) for _ in range(10)] == [[]] * 10


def test_a_weak_led_is_named_with_the_first_point() -> None:
    chart = ControlChart(LEDS, print)
    part = replace(PART, led_levels=(0.9, 0.846, 0.9, 0.9))  # of a part of another albedo
    told = [text for _ in range(20) for text in chart.add(part)]
    assert len(told) == 1
    assert told[0].startswith("LED 1 (tilt 90) at 94.0% of its taught level: least 95%")


@pytest.mark.parametrize(("change", "is_told"), [(0.003, False), (0.03, True)])
def test_only_a_change_that_matters_is_a_drift(change: float, is_told: bool) -> None:
    """The levels of a simulated rig hardly scatter: any rule would be broken by 0.1 %."""
    levels = np.ones((BASELINE_PARTS + 60, 4)) + np.random.default_rng(6).normal(0, 1e-4, 4)
    levels[BASELINE_PARTS:, 2] -= change
    draw = np.random.default_rng(6)
    told = fed(levels, np.exp(draw.normal(0.0, 0.1, len(levels))))
    assert [text for text in told if not text.startswith(("LED 2 (tilt 180)", "distance"))] == []
    assert any(text.startswith("LED 2 (tilt 180)") for text in told) == is_told


def test_charts_of_recorded_parts_warn_where_a_running_station_did() -> None:
    """The points, the baseline and the rules are the same; only low levels are not told."""
    parts = many("line-1", 600)
    watching = ControlChart(LEDS, print)
    told = {part.part_id: watching.add(part) for part in parts}
    running = [
        (part_id, text) for part_id, texts in told.items() for text in texts if "least" not in text
    ]
    distance, *levels = chart_histories(
        ChartedPart(**{name: getattr(part, name) for name in ChartedPart.__dataclass_fields__})
        for part in parts
        if part.label is not None
    )
    assert len(running) > 5
    assert len(distance.points) == sum(part.label is not None for part in parts) // 5
    recorded = {
        (point.part_id, text)
        for chart in (distance, *levels)
        for point in chart.points
        for text in point.new_rules
    }
    assert recorded == {(part_id, text.split(": ")[1].split(";")[0]) for part_id, text in running}
    assert distance.lower is not None
    assert distance.centre is not None
    assert distance.upper is not None
    assert 0.0 < distance.lower < distance.centre < distance.upper


def test_too_few_parts_have_no_baseline() -> None:
    parts = [ChartedPart(n, f"part-{n}", "", 0.4, (1.0, 0.9)) for n in range(99)]
    charts = chart_histories(parts)
    assert [len(chart.points) for chart in charts] == [19, 19, 19]
    assert {chart.centre for chart in charts} == {None}
    (alone,) = chart_histories([])
    assert alone.points == ()
