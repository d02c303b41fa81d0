"""`verdict_of`: the verdict on a part from its measures."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

from capture.station.domain.limits import (
    MEASURES_OF,
    ROWS,
    LimitedMeasures,
    Limits,
    Side,
    excess_text,
)
from capture.station.domain.recipe import Orientation, Recipe
from capture.station.domain.verdict import Cause, Decision, Verdict
from classify import Match
from classify.library.match import MIN_MARGIN
from classify.lighting import orientation_text
from classify.texture.orientation import MIN_SHARPNESS
from rig.acceptance import MAX_SATURATED_SHARE

STOP_LED_LEVEL = 0.85
"""Least level of an LED relative to the brightest, as a share of the taught ratio."""

_MAX_LIGHT_WHILE_OFF = 0.15
"""Largest share of an LED's light with all LEDs off; as large as the loss at `STOP_LED_LEVEL`."""


@dataclass(frozen=True)
class Finding:
    """One reason why a part does not pass, with its values and limits as text."""

    cause: Cause
    text: str


@dataclass(frozen=True, kw_only=True)
class Measures(LimitedMeasures):
    """Measures of the region of a part; None for one that was not measured."""

    match: Match | None = None
    saturated_fraction: float | None = None  # share of the pixels that a light saturates
    # Level of each LED relative to the brightest, as a share of the taught ratio.
    led_levels: tuple[tuple[str, float], ...] = ()
    least_led_level: float = STOP_LED_LEVEL
    # Share of each LED's light that the ambient image has.
    lit_while_off: tuple[tuple[str, float], ...] = ()


def verdict_of(recipe: Recipe, measures: Measures, faults: Sequence[Finding] = ()) -> Verdict:
    """Return the verdict on a part.

    Findings of the first of these stages count: faults of the set; validity of the measurement;
    texture and limits. A value that is NaN or missing gives ERROR.
    """
    findings = list(faults) or [*validity_findings(recipe, measures), *_level_findings(measures)]
    findings = findings or list(_texture_findings(recipe, measures))
    match = measures.match
    if findings or match is None or match.label not in recipe.passes:
        findings = findings or [Finding(Cause.UNFORESEEN, "the part was not matched")]
        findings.sort(key=lambda finding: finding.cause.gravity)
        causes = tuple(dict.fromkeys(finding.cause for finding in findings))
        text = "; ".join(dict.fromkeys(finding.text for finding in findings))
        return Verdict(causes[0].decision, text, causes)
    return Verdict(Decision.PASS, f"{match.label}, {_measures_text(recipe, measures, match)}")


def validity_findings(recipe: Recipe, measures: Measures) -> Iterator[Finding]:
    """Yield the reasons why the measurement is unusable for any texture."""
    yield from _limit_findings("unmeasured_fraction", recipe.limits, measures)
    saturated = measures.saturated_fraction
    yield from _bound_findings(
        "saturated pixels", saturated, "at most", MAX_SATURATED_SHARE, Cause.CAPTURE, ".1%"
    )
    for name, share in measures.lit_while_off:
        if not share <= _MAX_LIGHT_WHILE_OFF:
            text = f"{name} gives {share:.0%} of its light with all LEDs off, at most "
            yield Finding(Cause.RIG, f"{text}{_MAX_LIGHT_WHILE_OFF:.0%}")


def relative_levels(levels: Sequence[float]) -> list[float]:
    """Return levels of LEDs as shares of the brightest; 0 if no LED gives light."""
    brightest = max(levels)
    return [level / brightest if brightest > 0.0 else 0.0 for level in levels]


def _level_findings(measures: Measures) -> Iterator[Finding]:
    for name, level in measures.led_levels:
        if not level >= measures.least_led_level:
            text = (
                f"{name} at {level:.0%} of its taught level, least {measures.least_led_level:.0%}"
            )
            yield Finding(Cause.RIG, text)
    if not measures.led_levels:
        yield Finding(Cause.UNFORESEEN, "the levels of the LEDs were not measured")


def _texture_findings(recipe: Recipe, measures: Measures) -> Iterator[Finding]:
    match = measures.match
    if match is None:
        yield Finding(Cause.UNFORESEEN, "the texture was not matched")
        return
    limits = recipe.limits_for(match.label or match.nearest)
    match_findings = list(_match_findings(match, limits))
    yield from match_findings
    if match.label is None:
        if not match_findings:
            yield Finding(Cause.UNDECIDED, match.reason or "the texture is unknown")
        if match.nearest in recipe.passes:
            # The part may be of this texture, with a defect that makes it unknown.
            findings = chain.from_iterable(
                _limit_findings(key, limits, measures) for key in MEASURES_OF
            )
            yield from (finding for finding in findings if finding.cause is not Cause.UNFORESEEN)
    elif match.label in recipe.fails:
        yield Finding(Cause.BAD_TEXTURE, f"{match.label} is a bad texture, {match.reason}")
    elif match.label not in recipe.passes:
        yield Finding(Cause.WRONG_TEXTURE, f"{match.label} is not in the recipe, {match.reason}")
    else:
        yield from _orientation_findings(recipe.orientation, match)
        for key in MEASURES_OF:
            yield from _limit_findings(key, limits, measures)


def _match_findings(match: Match, limits: Limits) -> Iterator[Finding]:
    bounds = [bound for bound in (match.limit, limits.distance) if bound is not None]
    name = f"distance to {match.nearest}"
    if not bounds:
        yield Finding(Cause.UNFORESEEN, f"neither library nor recipe limits the {name}")
    else:
        limit = min(bounds)
        yield from _bound_findings(name, match.distance, "at most", limit, Cause.NO_TEXTURE, ".2f")
    if match.runner_up is not None:
        least = max(MIN_MARGIN, limits.margin or 0.0)
        name = f"margin to {match.runner_up}"
        yield from _bound_findings(name, match.margin, "at least", least, Cause.UNDECIDED, ".2f")
    yield from _limit_findings("blur_px", limits, match)


def _orientation_findings(rule: Orientation, match: Match) -> Iterator[Finding]:
    if rule.tolerance_deg is None:
        return
    measured_deg, period_deg = orientation_of(rule, match)
    if measured_deg is None or period_deg != rule.period_deg:
        yield Finding(Cause.UNDECIDED, f"the orientation of {match.label} is not clear")
        return
    name = f"sharpness of the orientation of {match.label}"
    yield from _bound_findings(
        name, match.sharpness, "at least", MIN_SHARPNESS, Cause.UNDECIDED, ".2f"
    )
    deviation_deg = rule.deviation_deg(measured_deg, rule.period_deg)
    name = f"degrees off {rule.reference_deg:g}"
    yield from _bound_findings(
        name, abs(deviation_deg), "at most", rule.tolerance_deg, Cause.ORIENTATION, ".1f"
    )


def orientation_of(rule: Orientation, match: Match) -> tuple[float | None, float | None]:
    """Return the orientation of a part and its period in degrees, None where it has none.

    The period is 360 if the rule tells apart parts that are rotated by 180 degrees, and the texture
    does.
    """
    if rule.full_turn and match.heading_deg is not None:
        return match.heading_deg, 360.0
    return match.orientation_deg, None if match.orientation_deg is None else 180.0


def _limit_findings(key: str, limits: Limits, measures: Measures | Match) -> Iterator[Finding]:
    """Yield a finding for each bound that a measure of the part exceeds, by its row in `ROWS`."""
    row, limit = ROWS[key], getattr(limits, key)
    if limit is not None:
        value = getattr(measures, row.measure or key)
        for side, bound in row.bounds(limit):
            yield from _bound_findings(row.label, value, side, bound, row.cause, row.format_spec)


def _bound_findings(
    name: str, value: float | None, side: Side, bound: float, cause: Cause, format_spec: str
) -> Iterator[Finding]:
    if value is None or not math.isfinite(value):
        yield Finding(Cause.UNFORESEEN, f"{name}: {'not measured' if value is None else value}")
    elif (text := excess_text(value, side, bound, format_spec)) is not None:
        yield Finding(cause, f"{name} {text}")


def _measures_text(recipe: Recipe, measures: Measures, match: Match) -> str:
    """Measures of a part that passes, with their limits, as text."""
    limits = recipe.limits_for(match.label or "")
    bounds = [bound for bound in (match.limit, limits.distance) if bound is not None]
    parts = [f"distance {match.distance:.2f} of {min(bounds):.2f}"]
    if recipe.orientation.tolerance_deg is not None:
        measured_deg, _ = orientation_of(recipe.orientation, match)
        text = orientation_text(measured_deg or 0.0, 0, recipe.orientation.period_deg)
        parts.append(f"at {text} degrees")
    parts += [
        row.text_within(getattr(measures, MEASURES_OF[key]), limit)
        for key, row in ROWS.items()
        if row.in_reason and (limit := getattr(limits, key)) is not None
    ]
    return ", ".join(parts)
