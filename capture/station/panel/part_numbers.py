"""Table of the numbers of a part beside the limits of the recipe that judged it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from capture.station.domain.limits import ROWS, Limits, Side, excess_text
from capture.station.domain.recipe import Recipe
from capture.station.domain.verdict import Cause, distinct_texts
from capture.station.results.part_result import PartResult
from classify.library.match import MIN_MARGIN

_NOT_MEASURED = "not measured"


@dataclass(frozen=True)
class _MeasuredNumber:
    """A line of the table."""

    name: str
    value: str
    limit: str = ""
    is_beyond: bool = False


def measured_numbers(result: PartResult, recipe: Recipe | None) -> Iterator[_MeasuredNumber]:
    """Yield the numbers of a part; without its recipe the only limit is that of the result."""
    texture = result.label or result.nearest or ""
    limits = Limits() if recipe is None else recipe.limits_for(texture)
    distances = [limit for limit in (result.limit, limits.distance) if limit is not None]
    to = f"distance to {result.nearest or 'the nearest texture'}"
    yield _number(to, result.distance, [("at most", min(distances))] if distances else [])
    margin_limit = max(MIN_MARGIN, limits.margin or 0.0)
    least: list[tuple[Side, float]] = [] if recipe is None else [("at least", margin_limit)]
    yield _number("margin to the next texture", result.margin, least)
    yield _orientation(result, recipe)
    for key, row in ROWS.items():
        if key not in ("distance", "margin"):
            value, limit = getattr(result, row.measure or key), getattr(limits, key)
            bounds = () if limit is None else tuple(row.bounds(limit))
            yield _number(row.label, value, bounds, row.format_spec)


def _number(
    name: str, value: float | None, bounds: Sequence[tuple[Side, float]], format_spec: str = ".2f"
) -> _MeasuredNumber:
    if value is None:
        limit = ", ".join(f"{side} {bound:{format_spec}}" for side, bound in bounds)
        return _MeasuredNumber(name, _NOT_MEASURED, limit)
    texts = [(side, *distinct_texts(value, bound, format_spec)) for side, bound in bounds]
    longest = max((text for _, text, _ in texts), key=len, default=f"{value:{format_spec}}")
    limit = ", ".join(f"{side} {bound}" for side, _, bound in texts)
    is_beyond = any(excess_text(value, side, bound, format_spec) for side, bound in bounds)
    return _MeasuredNumber(name, longest, limit, is_beyond)


def _orientation(result: PartResult, recipe: Recipe | None) -> _MeasuredNumber:
    degrees = result.orientation_deg
    value = _NOT_MEASURED if degrees is None else f"{degrees:.1f}°"
    limit = ""
    rule = None if recipe is None else recipe.orientation
    if rule is not None and (tolerance_deg := rule.tolerance_deg) is not None:
        limit = f"{rule.reference_deg:g} ± {tolerance_deg:g}°"
        if degrees is not None:
            off_deg = (degrees - rule.reference_deg + 90.0) % 180.0 - 90.0
            ends = [degrees - off_deg + side * tolerance_deg for side in (-1.0, 1.0)]
            value = max((distinct_texts(degrees, end, ".1f")[0] for end in ends), key=len) + "°"
    is_beyond = Cause.ORIENTATION in result.verdict.causes
    return _MeasuredNumber("orientation", value, limit, is_beyond)
