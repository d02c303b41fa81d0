"""`Limits` of a recipe, and `LimitedMeasures`: the measures of a part that the limits bound.

A new measure needs a field in `LimitedMeasures`, which is also its column in the results, and a row
in `Limits`. The verdict, the texts of a recipe, forms and pages read the rows.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from classify.base.models import Section

from .verdict import Cause

_Positive = Annotated[float, Field(gt=0.0, le=1e6)]
_Share = Annotated[float, Field(ge=0.0, le=1.0)]
_Pixels = Annotated[int, Field(ge=0)]
Side = Literal["at least", "at most"]
"""Side of a bound on which values are allowed."""
# Significant digits that distinguish all 64-bit floats.
_MAX_DIGITS = 17
_Range = tuple[Annotated[float, Field(ge=0.0)], _Positive]


@dataclass(frozen=True, kw_only=True)
class LimitedMeasures:
    """Measures of a part, each with a limit in `Limits`; None for what was not measured."""

    sdq: float | None = None
    shadow_fraction: float | None = None  # share of the region
    unmeasured_fraction: float | None = None  # share of the region
    albedo: float | None = None
    # Median standard deviation of the normal in degrees; measured only if it has a limit.
    angle_sd: float | None = None
    scale: float | None = None
    handedness: float | None = None
    octaves: float | None = None
    window: float | None = None
    seam: float | None = None
    defect_score: float | None = None
    unjudged_px: int | None = None


@dataclass(frozen=True)
class LimitRow:
    """A row of the table: how a limit and its measure are judged and shown."""

    label: str  # of the measure
    kind: Literal["least", "largest", "range"]
    cause: Cause  # of a value beyond the limit
    format_spec: str  # of measure and limit, such as ``.2f``
    of_teaching: bool = False  # whether teaching measures the limit
    in_reason: bool = False  # whether the reason of a PASS names the measure
    measure: str = ""  # field of `LimitedMeasures`; empty if it has the name of the limit

    def bounds(self, limit: float | _Range) -> Iterator[tuple[Side, float]]:
        """Yield the bounds of a limit."""
        least, largest = limit if isinstance(limit, tuple) else (limit, limit)
        if self.kind != "largest":
            yield "at least", least
        if self.kind != "least":
            yield "at most", largest

    def text_within(self, value: float, limit: float | _Range) -> str:
        """Return a measure within its limit, as text."""
        if isinstance(limit, tuple):
            low, high = (f"{bound:{self.format_spec}}" for bound in limit)
            return f"{self.label} {value:{self.format_spec}} within {low} to {high}"
        return f"{self.label} {value:{self.format_spec}} of {limit:{self.format_spec}}"


def distinct_texts(value: float, bound: float, format_spec: str) -> tuple[str, str]:
    """Return two numbers as texts, with as many digits more as they need to differ."""
    digits, kind = int(format_spec[1:-1]), format_spec[-1]
    if math.isfinite(value) and value != bound:
        while digits < _MAX_DIGITS and f"{value:.{digits}{kind}}" == f"{bound:.{digits}{kind}}":
            digits += 1
    return f"{value:.{digits}{kind}}", f"{bound:.{digits}{kind}}"


def excess_text(value: float, side: Side, bound: float, format_spec: str) -> str | None:
    """Return a value beyond a bound and the bound, as text; None if it is not beyond."""
    is_within = value >= bound if side == "at least" else value <= bound
    if is_within:
        return None
    value_text, limit = distinct_texts(value, bound, format_spec)
    return f"{value_text}, {side} {limit}"


class Limits(Section):
    """Limits of a part that passes, each with its row; None sets no limit."""

    distance: Annotated[
        _Positive | None,
        LimitRow("distance", "largest", Cause.NO_TEXTURE, ".2f", of_teaching=True),
    ] = Field(
        default=None, description="largest distance to the texture, beside the library's limit"
    )
    margin: Annotated[
        _Share | None,
        LimitRow("margin", "least", Cause.UNDECIDED, ".2f"),
    ] = Field(
        default=None, description="least margin to the next texture, beside the library's 0.15"
    )
    sdq: Annotated[
        _Range | None,
        LimitRow("Sdq", "range", Cause.ROUGHNESS, ".3f", of_teaching=True, in_reason=True),
    ] = Field(
        default=None,
        strict=False,
        description="least and largest root mean square slope (ISO 25178-2)",
    )
    shadow_fraction: Annotated[
        _Share | None,
        LimitRow("shadow", "largest", Cause.SHADOW, ".1%", of_teaching=True),
    ] = Field(default=None, description="largest share of pixels that a light does not reach")
    unmeasured_fraction: Annotated[
        _Share | None,
        LimitRow("pixels without a slope", "largest", Cause.CAPTURE, ".1%", of_teaching=True),
    ] = Field(default=None, description="largest share of pixels without a slope")
    blur_px: Annotated[
        _Positive | None,
        LimitRow("blur in px", "largest", Cause.BLUR, ".2f"),
    ] = Field(default=None, description="largest blur in px relative to the taught parts")
    albedo: Annotated[
        _Range | None,
        LimitRow("albedo", "range", Cause.ALBEDO, ".3f", of_teaching=True),
    ] = Field(
        default=None,
        strict=False,
        description="least and largest mean albedo, a share of full scale at the taught exposure",
    )
    angle_sd: Annotated[
        _Positive | None,
        LimitRow("standard deviation of the normal in degrees", "largest", Cause.CAPTURE, ".2f"),
    ] = Field(
        default=None,
        description="largest median standard deviation of the normal, in degrees",
    )
    scale: Annotated[
        _Range | None,
        LimitRow("scale", "range", Cause.SCALE, ".3f", of_teaching=True),
    ] = Field(
        default=None,
        strict=False,
        description="least and largest ratio of the texture's size to the taught size",
    )
    handedness: Annotated[
        Annotated[float, Field(ge=-10.0, le=10.0)] | None,
        LimitRow("handedness", "least", Cause.HANDEDNESS, ".2f", of_teaching=True),
    ] = Field(default=None, description="least handedness: 1 as taught, -1 in a mirror")
    octaves: Annotated[
        _Positive | None,
        LimitRow("power in octaves", "largest", Cause.OCTAVES, ".2f"),
    ] = Field(
        default=None,
        description="largest departure of the power in an octave; 1 is the taught limit",
    )
    window: Annotated[
        _Positive | None,
        LimitRow("window score", "largest", Cause.WINDOW, ".2f", in_reason=True),
    ] = Field(
        default=None,
        description="largest difference of a spot or window from good ones; 1 is the taught limit",
    )
    seam: Annotated[
        _Positive | None,
        LimitRow("seam score", "largest", Cause.SEAM, ".2f", in_reason=True),
    ] = Field(
        default=None,
        description="largest difference of a window's directions from those of good windows; 1 is "
        "the taught limit",
    )
    defect: Annotated[
        _Positive | None,
        LimitRow(
            "defect score", "largest", Cause.DEFECT, ".2f", in_reason=True, measure="defect_score"
        ),
    ] = Field(
        default=None, description="largest score of the defect map; 1 is the taught threshold"
    )
    unjudged_px: Annotated[
        _Pixels | None,
        LimitRow("px without a defect score", "largest", Cause.DEFECT, ".0f", of_teaching=True),
    ] = Field(default=None, description="largest area without a score in the defect map, in px")

    @model_validator(mode="after")
    def _ranges_rise(self) -> Self:
        for name in RANGES:
            limit = getattr(self, name)
            if limit is not None and not limit[0] < limit[1]:
                raise ValueError(f"{name} = {list(limit)}: give the least and the largest value")
        return self


class GeneralLimits(Limits):
    """Limits of all textures, with the default values of those that a recipe does not set."""

    unmeasured_fraction: _Share = 0.05  # teaching raises it to the share of the good parts
    # A Gaussian of 1 px leaves 8 % of the power at 0.25 cycles per pixel, and less above: the
    # finest octave is lost.
    blur_px: _Positive = 1.0
    octaves: _Positive = 1.0
    window: _Positive = 1.0
    seam: _Positive = 1.0
    defect: _Positive = 1.0
    # Four adjacent cells of the defect map (256 px) without a score are a hole in the surface.
    unjudged_px: _Pixels = 255


# Limits of fields of a match, which `LimitedMeasures` lacks; the library bounds distance and margin
# as well.
_MATCH_FIELDS = ("distance", "margin", "blur_px")
ROWS = {
    name: next(row for row in field.metadata if isinstance(row, LimitRow))
    for name, field in Limits.model_fields.items()
}
"""The rows of the table, by the key of the limit."""
RANGES = tuple(name for name, row in ROWS.items() if row.kind == "range")
"""Limits that have a least and a largest value."""
MEASURES_OF = {name: row.measure or name for name, row in ROWS.items() if name not in _MATCH_FIELDS}
"""The field of `LimitedMeasures` that each limit bounds."""
if sorted(MEASURES_OF.values()) != sorted(field.name for field in fields(LimitedMeasures)):
    raise TypeError("each field of LimitedMeasures needs one row of Limits")
