"""Table of the numbers of a part beside the limits of the recipe that judged it."""

from collections.abc import Iterator
from dataclasses import dataclass

from capture.station.domain.digits import told_apart
from capture.station.domain.recipe import Limits, Recipe
from capture.station.domain.verdict import Cause
from capture.station.results.part_result import PartResult
from classify.library.match import LEAST_MARGIN

_NOT_MEASURED = "not measured"


@dataclass(frozen=True)
class MeasuredNumber:
    """A line of the table."""

    name: str
    value: str
    limit: str = ""
    is_beyond: bool = False


def measured_numbers(result: PartResult, recipe: Recipe | None) -> list[MeasuredNumber]:
    """Return the numbers of a part; without its recipe the only limit is that of the result."""
    return list(_numbers(result, recipe))


def _numbers(result: PartResult, recipe: Recipe | None) -> Iterator[MeasuredNumber]:
    texture = result.label or result.nearest or ""
    limits = Limits() if recipe is None else recipe.limits_for(texture)
    distances = [each for each in (result.limit, limits.distance) if each is not None]
    to = f"distance to {result.nearest or 'the nearest texture'}"
    yield _number(to, result.distance, high=min(distances, default=None))
    least = None if recipe is None else max(LEAST_MARGIN, limits.margin or 0.0)
    yield _number("margin to the next texture", result.margin, low=least)
    yield _orientation(result, recipe)
    for name, value, bounds in (
        ("Sdq, root mean square slope", result.sdq, limits.sdq),
        ("albedo", result.albedo, limits.albedo),
        ("scale", result.scale, limits.scale),
    ):
        low, high = bounds or (None, None)
        yield _number(name, value, low, high, ".3f")
    yield _number("handedness", result.handedness, low=limits.handedness)
    yield _number("shadow", result.shadow_fraction, high=limits.shadow_fraction, form=".1%")
    yield _number("blur in px", result.blur_px, high=limits.blur_px)
    yield _number("power in octaves", result.octaves, high=limits.octaves)
    yield _number("seam score", result.seam, high=limits.seam)
    yield _number("window score", result.window, high=limits.window)
    yield _number("defect score", result.defect_score, high=limits.defect)


def _number(
    name: str,
    value: float | None,
    low: float | None = None,
    high: float | None = None,
    form: str = ".2f",
) -> MeasuredNumber:
    bounds = [("at least", low)] if low is not None else []
    bounds += [("at most", high)] if high is not None else []
    if value is None:
        limit = ", ".join(f"{words} {bound:{form}}" for words, bound in bounds)
        return MeasuredNumber(name, _NOT_MEASURED, limit)
    texts = [(words, *told_apart(value, bound, form)) for words, bound in bounds]
    shown = max((text for _, text, _ in texts), key=len, default=f"{value:{form}}")
    limit = ", ".join(f"{words} {bound}" for words, _, bound in texts)
    is_beyond = (low is not None and value < low) or (high is not None and value > high)
    return MeasuredNumber(name, shown, limit, is_beyond)


def _orientation(result: PartResult, recipe: Recipe | None) -> MeasuredNumber:
    degrees = result.orientation_deg
    value = _NOT_MEASURED if degrees is None else f"{degrees:.1f}°"
    limit = ""
    rule = None if recipe is None else recipe.orientation
    if rule is not None and (tolerance_deg := rule.tolerance_deg) is not None:
        limit = f"{rule.reference_deg:g} ± {tolerance_deg:g}°"
        if degrees is not None:
            off_deg = (degrees - rule.reference_deg + 90.0) % 180.0 - 90.0
            ends = [degrees - off_deg + side * tolerance_deg for side in (-1.0, 1.0)]
            value = max((told_apart(degrees, end, ".1f")[0] for end in ends), key=len) + "°"
    is_beyond = Cause.ORIENTATION in result.verdict.causes
    return MeasuredNumber("orientation", value, limit, is_beyond)
