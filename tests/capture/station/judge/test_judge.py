"""Tests of `verdict_of`: nothing passes unless every condition holds."""

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.station.domain.recipe import (
    GeneralLimits,
    Limits,
    Orientation,
    Recipe,
)
from capture.station.domain.verdict import Cause, Decision
from capture.station.judge.inspector import Inspection
from capture.station.judge.judge import (
    STOP_LED_LEVEL,
    Finding,
    Measures,
    verdict_of,
)
from capture.station.line.registers import registers_of
from capture.station.panel.result_pages import measured_numbers
from classify import Match
from tests.capture.station.results.parts import minimal

GOOD_MATCH = Match(
    label="steel",
    nearest="steel",
    orientation_deg=2.0,
    distance=1.0,
    runner_up="tin",
    runner_up_distance=4.0,
    margin=0.75,
    limit=2.0,
    sharpness=0.9,
    heading_deg=2.0,
    blur_px=0.1,
)
GOOD = Measures(
    match=GOOD_MATCH,
    unmeasured_fraction=0.0,
    saturated_fraction=0.0,
    led_levels=(("LED 0", 1.0), ("LED 90", 0.97)),
    lit_while_off=(("LED 0", 0.0), ("LED 90", 0.1)),
    sdq=0.2,
    shadow_fraction=0.1,
    albedo=0.4,
    scale=1.0,
    handedness=1.0,
    octaves=0.4,
    window=0.6,
    seam=0.5,
    defect_score=0.5,
    unjudged_px=0,
)
RECIPE = Recipe(
    name="sheet",
    passes=("steel",),
    fails=("rust",),
    orientation=Orientation(tolerance_deg=5.0),
    limits=GeneralLimits(
        distance=1.5,
        margin=0.2,
        sdq=(0.1, 0.3),
        shadow_fraction=0.2,
        albedo=(0.3, 0.5),
        scale=(0.99, 1.01),
        handedness=0.0,
    ),
)


def of_match(**changes: object) -> Measures:
    return replace(GOOD, match=replace(GOOD_MATCH, **changes))


@pytest.mark.parametrize(
    ("measures", "cause", "reason"),
    [
        (GOOD, None, "steel, distance 1.00 of 1.50, at 2 degrees, Sdq 0.200"),
        (of_match(limit=None), None, "of 1.50"),
        (of_match(orientation_deg=176.0), None, "at 176 degrees"),
        (of_match(orientation_deg=179.98), None, "at 0 degrees"),
        (replace(GOOD, match=None), Cause.UNFORESEEN, "match"),
        (replace(GOOD, unmeasured_fraction=0.2), Cause.CAPTURE, "20.0%, at most 5.0%"),
        (replace(GOOD, saturated_fraction=0.02), Cause.CAPTURE, "2.0%, at most 1.0%"),
        (replace(GOOD, led_levels=(("LED 180", 0.61),)), Cause.RIG, "LED 180 at 61%"),
        (replace(GOOD, lit_while_off=(("LED 180", 0.2),)), Cause.RIG, "LED 180 gives 20%"),
        (replace(GOOD, led_levels=()), Cause.UNFORESEEN, "LEDs"),
        (of_match(label=None, distance=2.5), Cause.NO_TEXTURE, "steel 2.50, at most 1.50"),
        (of_match(distance=1.6), Cause.NO_TEXTURE, "1.60, at most 1.50"),
        (of_match(margin=0.18), Cause.UNDECIDED, "tin 0.18, at least 0.20"),
        (of_match(label=None, reason="equally near"), Cause.UNDECIDED, "equally"),
        (of_match(blur_px=1.4), Cause.BLUR, "1.40, at most 1.00"),
        (of_match(sharpness=0.1), Cause.UNDECIDED, "steel 0.10, at least 0.45"),
        (of_match(orientation_deg=None), Cause.UNDECIDED, "orientation"),
        (of_match(label="rust", nearest="rust"), Cause.BAD_TEXTURE, "rust"),
        (of_match(label="tin"), Cause.WRONG_TEXTURE, "tin"),
        (of_match(orientation_deg=8.0), Cause.ORIENTATION, "8.0, at most 5.0"),
        (replace(GOOD, sdq=0.4), Cause.ROUGHNESS, "Sdq 0.400, at most 0.300"),
        (replace(GOOD, sdq=0.05), Cause.ROUGHNESS, "Sdq 0.050, at least 0.100"),
        (replace(GOOD, shadow_fraction=0.3), Cause.SHADOW, "30.0%, at most 20.0%"),
        (replace(GOOD, albedo=0.2), Cause.ALBEDO, "albedo 0.200, at least 0.300"),
        (replace(GOOD, scale=1.05), Cause.SCALE, "scale 1.050, at most 1.010"),
        (replace(GOOD, scale=0.95), Cause.SCALE, "scale 0.950, at least 0.990"),
        (replace(GOOD, handedness=-1.0), Cause.HANDEDNESS, "-1.00, at least 0.00"),
        (replace(GOOD, handedness=None), Cause.UNFORESEEN, "handedness"),
        (replace(GOOD, octaves=1.2), Cause.OCTAVES, "octaves 1.20, at most 1.00"),
        (replace(GOOD, seam=1.2), Cause.SEAM, "seam score 1.20, at most 1.00"),
        (replace(GOOD, window=1.2), Cause.WINDOW, "window score 1.20, at most 1.00"),
        (replace(GOOD, window=None), Cause.UNFORESEEN, "window score"),
        (replace(GOOD, defect_score=1.2), Cause.DEFECT, "1.20, at most 1.00"),
        (replace(GOOD, unjudged_px=256), Cause.DEFECT, "256, at most 255"),
        (replace(GOOD, defect_score=math.nan), Cause.UNFORESEEN, "score: nan"),
        (replace(GOOD, defect_score=None), Cause.UNFORESEEN, "score"),
        (of_match(distance=-math.inf), Cause.UNFORESEEN, "distance"),
    ],
)
def test_a_verdict_names_its_cause_with_value_and_limit(
    measures: Measures, cause: Cause | None, reason: str
) -> None:
    verdict = verdict_of(RECIPE, measures)
    assert verdict.causes[:1] == (() if cause is None else (cause,))
    assert verdict.decision is (Decision.PASS if cause is None else cause.decision)
    assert reason in verdict.reason


def test_validity_comes_before_texture() -> None:
    bad = replace(of_match(label="rust"), saturated_fraction=0.5, led_levels=(("LED 0", 0.1),))
    assert verdict_of(RECIPE, bad).causes == (Cause.CAPTURE, Cause.RIG)
    fault = Finding(Cause.CALIBRATION, "of another rig")
    assert verdict_of(RECIPE, GOOD, [fault]).reason == "of another rig"


def test_all_that_speaks_against_a_part_is_said_the_gravest_first() -> None:
    measures = replace(of_match(blur_px=2.0, orientation_deg=40.0), defect_score=3.0)
    verdict = verdict_of(RECIPE, measures)
    assert verdict.decision is Decision.UNKNOWN
    assert verdict.causes == (Cause.BLUR, Cause.ORIENTATION, Cause.DEFECT)
    assert verdict.reason.count(";") == 2


def test_a_whole_turn_needs_a_heading() -> None:
    orientation = Orientation(tolerance_deg=5.0, reference_deg=180.0, full_turn=True)
    recipe = RECIPE.model_copy(update={"orientation": orientation})
    assert verdict_of(recipe, GOOD).causes == (Cause.ORIENTATION,)
    passed = verdict_of(recipe, of_match(heading_deg=182.0))
    assert passed.decision is Decision.PASS
    assert "at 182 degrees" in passed.reason
    assert verdict_of(recipe, of_match(heading_deg=None)).causes == (Cause.UNDECIDED,)


@pytest.mark.parametrize(
    ("full_turn", "heading_deg", "recorded"),
    [
        (True, 182.0, (182.0, 360.0)),
        (False, 182.0, (2.0, 180.0)),
        (True, None, (2.0, 180.0)),
    ],
)
def test_a_result_has_the_orientation_that_was_judged(
    full_turn: bool, heading_deg: float | None, recorded: tuple[float, float]
) -> None:
    rule = Orientation(tolerance_deg=5.0, reference_deg=180.0, full_turn=full_turn)
    recipe = RECIPE.model_copy(update={"orientation": rule})
    measures = of_match(heading_deg=heading_deg)
    inspection = Inspection(verdict_of(recipe, measures), measures, orientation_rule=rule)
    result = inspection.recorded(minimal())
    assert (result.orientation_deg, result.orientation_period_deg) == recorded
    numbers = {number.name: number.value for number in measured_numbers(result, recipe)}
    assert numbers[f"orientation, over {recorded[1]:g}°"] == f"{recorded[0]:.1f}°"
    registers = registers_of(result)
    assert registers["orientation"] == 10 * recorded[0]
    assert registers["orientation_period"] == recorded[1]


def test_a_library_of_one_texture_has_no_margin() -> None:
    alone = of_match(runner_up=None, runner_up_distance=None, margin=None)
    assert verdict_of(RECIPE, alone).decision is Decision.PASS
    assert verdict_of(RECIPE, of_match(margin=None)).decision is Decision.ERROR


ANGLES = st.floats(-1000.0, 1000.0)
NUMBERS = st.none() | st.floats() | st.sampled_from([0.0, 0.5, 0.99, 1.0])
LABELS = st.sampled_from([None, "steel", "tin", "rust", "wood"])
MATCHES = st.builds(
    Match,
    label=LABELS,
    nearest=st.just("steel"),
    orientation_deg=NUMBERS | ANGLES,
    distance=st.floats(),
    runner_up=st.sampled_from([None, "tin"]),
    runner_up_distance=NUMBERS,
    margin=NUMBERS,
    limit=NUMBERS,
    sharpness=NUMBERS,
    heading_deg=NUMBERS | ANGLES,
    blur_px=NUMBERS,
)
MEASURES = st.builds(
    Measures,
    match=st.none() | MATCHES | st.just(GOOD_MATCH),
    unmeasured_fraction=NUMBERS,
    saturated_fraction=NUMBERS,
    led_levels=st.sampled_from([(), (("LED 0", math.nan),), (("LED 0", 1.0),), (("LED 0", 0.8),)]),
    sdq=NUMBERS,
    shadow_fraction=NUMBERS,
    albedo=NUMBERS,
    scale=NUMBERS,
    handedness=NUMBERS,
    octaves=NUMBERS,
    window=NUMBERS,
    seam=NUMBERS,
    defect_score=NUMBERS,
    unjudged_px=st.none() | st.integers(),
)
LIMITS = st.builds(
    Limits,
    distance=st.none() | st.floats(0.1, 10.0),
    margin=st.none() | st.floats(0.0, 1.0),
    sdq=st.none() | st.just((0.1, 1.5)),
    shadow_fraction=st.none() | st.floats(0.0, 1.0),
    blur_px=st.none() | st.floats(0.1, 3.0),
    albedo=st.none() | st.just((0.1, 1.5)),
    scale=st.none() | st.just((0.9, 1.1)),
    handedness=st.none() | st.floats(-1.0, 1.0),
    octaves=st.none() | st.floats(0.1, 3.0),
    window=st.none() | st.floats(0.1, 3.0),
    seam=st.none() | st.floats(0.1, 3.0),
    defect=st.none() | st.floats(0.1, 3.0),
)
RULES = st.builds(
    Orientation,
    tolerance_deg=st.none() | st.floats(0.1, 180.0),
    reference_deg=st.floats(-360.0, 360.0),
    full_turn=st.booleans(),
)


def holds(value: float | None, low: float, high: float) -> bool:
    return value is not None and math.isfinite(value) and low <= value <= high


def every_condition_holds(recipe: Recipe, m: Measures) -> bool:
    """The conditions of PASS, written down once more and in another way."""
    match = m.match
    if match is None or match.label not in recipe.passes:
        return False
    limits, rule = recipe.limits_for(match.label), recipe.orientation
    bounds = [each for each in (match.limit, limits.distance) if each is not None]
    conditions = [
        bool(bounds),
        *(holds(match.distance, -math.inf, bound) for bound in bounds),
        holds(m.saturated_fraction, -math.inf, 0.01),
        bool(m.led_levels),
        *(holds(level, STOP_LED_LEVEL, math.inf) for _, level in m.led_levels),
        match.runner_up is None or holds(match.margin, max(0.15, limits.margin or 0.0), math.inf),
        limits.sdq is None or holds(m.sdq, *limits.sdq),
        limits.albedo is None or holds(m.albedo, *limits.albedo),
        limits.scale is None or holds(m.scale, *limits.scale),
        limits.handedness is None or holds(m.handedness, limits.handedness, math.inf),
        *(
            bound is None or holds(value, -math.inf, bound)
            for value, bound in (
                (m.shadow_fraction, limits.shadow_fraction),
                (m.unmeasured_fraction, recipe.limits.unmeasured_fraction),
                (m.unmeasured_fraction, limits.unmeasured_fraction),
                (match.blur_px, limits.blur_px),
                (m.octaves, limits.octaves),
                (m.seam, limits.seam),
                (m.window, limits.window),
                (m.defect_score, limits.defect),
                (m.unjudged_px, limits.unjudged_px),
            )
        ),
    ]
    if rule.tolerance_deg is not None:
        found_deg = match.heading_deg if rule.full_turn else match.orientation_deg
        if found_deg is None or not math.isfinite(found_deg):
            return False
        apart = math.radians(found_deg - rule.reference_deg)
        if not rule.full_turn:
            apart = 2.0 * apart
        off_deg = abs(math.degrees(math.atan2(math.sin(apart), math.cos(apart))))
        off_deg = off_deg if rule.full_turn else off_deg / 2.0
        # Both ways of computing the angle round.
        conditions += [holds(match.sharpness, 0.45, math.inf), off_deg <= rule.tolerance_deg + 1e-6]
    return all(conditions)


@settings(max_examples=200, deadline=None)
@given(MEASURES, LIMITS, RULES)
def test_no_part_passes_unless_every_condition_holds(
    measures: Measures, limits: Limits, rule: Orientation
) -> None:
    recipe = Recipe(
        name="sheet",
        passes=("steel", "wood"),
        fails=("rust",),
        orientation=rule,
        limits_of={"steel": limits},
    )
    verdict = verdict_of(recipe, measures)
    if verdict.decision is Decision.PASS:
        assert every_condition_holds(recipe, measures)
    else:
        assert verdict.reason
        assert "\n" not in verdict.reason


GOOD_MEASURES = st.builds(
    lambda name, value: replace(GOOD, **{name: value})
    if hasattr(GOOD, name)
    else of_match(**{name: value}),
    st.sampled_from(
        ["unmeasured_fraction", "saturated_fraction", "sdq", "shadow_fraction", "defect_score",
         "albedo", "scale", "handedness", "octaves", "window", "seam", "distance", "margin",
         "blur_px", "sharpness"]
    ),
    st.floats(),
)  # fmt: skip


@settings(max_examples=200, deadline=None)
@given(GOOD_MEASURES)
def test_a_part_passes_exactly_if_every_condition_holds(measures: Measures) -> None:
    passed = verdict_of(RECIPE, measures).decision is Decision.PASS
    assert passed == every_condition_holds(RECIPE, measures)


def test_every_limit_that_an_unknown_part_exceeds_is_named_once() -> None:
    part = replace(of_match(label=None, distance=2.5), sdq=0.4, defect_score=1.2, scale=math.nan)
    verdict = verdict_of(RECIPE, part)
    assert verdict.decision is Decision.UNKNOWN
    assert verdict.causes == (Cause.NO_TEXTURE, Cause.ROUGHNESS, Cause.DEFECT)
    assert verdict.reason.count("distance to steel") == 1
    assert "Sdq 0.400, at most 0.300" in verdict.reason


def test_the_limits_of_an_unknown_part_are_those_of_the_nearest_texture() -> None:
    recipe = RECIPE.model_copy(update={"limits_of": {"steel": Limits(distance=0.83)}})
    verdict = verdict_of(recipe, of_match(label=None, distance=1.4, limit=1.38))
    assert verdict.reason == "distance to steel 1.40, at most 0.83"
