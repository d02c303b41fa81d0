"""`Recipe`: the textures that pass and their limits; people approve its file."""

from collections.abc import Mapping
from typing import Annotated, Self

from pydantic import (
    ConfigDict,
    Field,
    FiniteFloat,
    model_validator,
)

from capture.session.plan import Label, Name, Text
from capture.station.domain.errors import NotApproved
from classify.base.section import Section
from rig.set_file import fields_sha256

_DIGITS = 8  # of a hash that is shown
_MAX_TEXTURES = 1000  # bounds the file; `station bench` measures a recipe with 30 textures

Positive = Annotated[float, Field(gt=0.0, le=1e6)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Range = tuple[Annotated[float, Field(ge=0.0)], Positive]
RANGES = ("sdq", "albedo", "scale")
"""Limits that have a least and a largest value."""
Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class Orientation(Section):
    """How a part must lie."""

    # Largest difference from `reference_deg`; None accepts every orientation.
    tolerance_deg: Annotated[float, Field(gt=0.0, le=180.0)] | None = None
    # Anticlockwise, with the zero of the taught parts.
    reference_deg: Annotated[FiniteFloat, Field(ge=-360.0, le=360.0)] = 0.0
    full_turn: bool = False  # whether a part at `reference_deg` + 180 degrees is wrong


class Limits(Section):
    """Limits of a part that passes; None sets no limit."""

    distance: Positive | None = None  # largest distance, beside the limit of the library
    margin: Share | None = None  # least margin, beside that of the library, 0.15
    # Least and largest root mean square slope (ISO 25178-2).
    sdq: Range | None = Field(default=None, strict=False)
    shadow_fraction: Share | None = None  # largest share of pixels that a light does not reach
    unmeasured_fraction: Share | None = None  # largest share of pixels without a slope
    blur_px: Positive | None = None  # largest blur against the taught parts, sigma of a Gaussian
    # Least and largest mean, as a share of full scale at the taught exposure.
    albedo: Range | None = Field(default=None, strict=False)
    # Least and largest size of the texture against the taught one.
    scale: Range | None = Field(default=None, strict=False)
    # Least; 1 is that of the taught parts, -1 that of their mirror images.
    handedness: Annotated[float, Field(ge=-10.0, le=10.0)] | None = None
    # Largest departure of the power in an octave; 1 is the taught limit.
    octaves: Positive | None = None
    window: Positive | None = None  # largest score of a window; 1 is the taught limit
    seam: Positive | None = None  # largest score of a window's directions; 1 is the taught limit
    defect: Positive | None = None  # largest score of the defect map; 1 is the taught threshold
    # Largest connected area without a score in the defect map.
    unjudged_px: Annotated[int, Field(ge=0)] | None = None

    @model_validator(mode="after")
    def _ranges_rise(self) -> Self:
        for name in RANGES:
            found = getattr(self, name)
            if found is not None and not found[0] < found[1]:
                raise ValueError(f"{name} = {list(found)}: give the least and the largest value")
        return self


class GeneralLimits(Limits):
    """Limits of all textures, with the default values of those that a recipe does not set."""

    unmeasured_fraction: Share = 0.05  # teaching takes it from the good parts
    blur_px: Positive = 1.0  # it removes the finest scale (``classify/texture/blur.py``)
    octaves: Positive = 1.0
    window: Positive = 1.0
    seam: Positive = 1.0
    defect: Positive = 1.0
    # Four adjacent cells of the defect map (256 px) without a score are a hole in the surface.
    unjudged_px: Annotated[int, Field(ge=0)] = 255


class Region(Section):
    """Judged part of the image, in px: column and row of its top left corner, size."""

    x: int = Field(ge=0, le=32767)
    y: int = Field(ge=0, le=32767)
    width: int = Field(ge=16, le=32768)
    height: int = Field(ge=16, le=32768)

    def __str__(self) -> str:
        return f"{self.width} x {self.height} px at column {self.x}, row {self.y}"


class Light(Section):
    """Settings of the camera for this recipe; None leaves those of ``rig.toml``."""

    exposure_ms: Annotated[float, Field(gt=0.0, le=10_000.0)] | None = None
    gain: int | None = Field(default=None, ge=0, le=2**31 - 1)


class CalibrationRule(Section):
    """Whether a calibration is required, and the greatest age of its oldest part.

    365 days is the usual interval for instruments (ILAC-G24, OIML D 10).
    """

    required: bool = False
    max_age_days: int = Field(default=365, ge=1, le=36_500)

    def age_fault(self, age_days: int | None) -> str | None:
        """Return why a calibration part of this age is not usable; None if it is."""
        if age_days is None:
            return "has a date that cannot be read; calibrate again"
        if age_days < -1:  # the clocks of two computers may differ
            return "was measured after the part; set the clock, or calibrate again"
        if age_days > self.max_age_days:
            return (
                f"was measured {age_days} days before the part, at most {self.max_age_days}; "
                "calibrate again"
            )
        return None


class Approval(Section):
    """Who approved a recipe, when (UTC), and the hash of the recipe that was approved."""

    by: Text = Field(min_length=1, max_length=200)
    utc: Text = Field(min_length=1, max_length=40)
    sha256: Sha256


class Recipe(Section):
    """Which textures pass, with which limits, on which region, under which light."""

    model_config = ConfigDict(populate_by_name=True)

    name: Name
    version: int = Field(default=1, ge=1, le=2**31 - 1)  # raised by each teaching, from 1
    note: Text | None = Field(default=None, max_length=1000)
    # Textures of parts that pass.
    passes: tuple[Label, ...] = Field(alias="pass", max_length=_MAX_TEXTURES, strict=False)
    # Textures of known bad parts; a texture of the library in neither list fails too.
    fails: tuple[Label, ...] = Field(
        default=(), alias="fail", max_length=_MAX_TEXTURES, strict=False
    )
    orientation: Orientation = Orientation()
    limits: GeneralLimits = GeneralLimits()
    # Limits that differ for one texture.
    limits_of: Mapping[Label, Limits] = Field(default_factory=dict)
    region: Region | None = None
    light: Light = Light()
    calibration: CalibrationRule = CalibrationRule()
    # Faults of a fifth of the frame that pass, by their name in `made_faults.FAULTS`.
    acknowledged: tuple[Text, ...] = Field(default=(), max_length=100, strict=False)
    # Hash of what teaching measured; None for a recipe that was never taught.
    taught: Sha256 | None = None
    approval: Approval | None = None

    @model_validator(mode="after")
    def _textures_are_named_once(self) -> Self:
        named = [*self.passes, *self.fails]
        twice = next((each for each in named if named.count(each) > 1), None)
        if twice is not None:
            raise ValueError(f"pass, fail: {twice!r} is named twice; name each texture once")
        other = next((each for each in self.limits_of if each not in self.passes), None)
        if other is not None:
            raise ValueError(f"limits_of.{other}: is not in pass; leave these limits out")
        return self

    @property
    def sha256(self) -> str:
        """Hash of everything but the approval. Not cached: `model_copy` would copy it too."""
        return fields_sha256(self.model_dump(mode="json", by_alias=True, exclude={"approval"}))

    @property
    def version_text(self) -> str:
        """Version and the beginning of the hash, for people to compare."""
        return f"version {self.version}, {self.sha256[:_DIGITS]}"

    @property
    def is_approved(self) -> bool:
        """Whether somebody approved exactly this recipe."""
        return self.approval is not None and self.approval.sha256 == self.sha256

    def limits_for(self, texture: str) -> Limits:
        """Return the limits of a texture: its own ones, and the general ones for the rest."""
        own = self.limits_of.get(texture, Limits())
        return Limits.model_validate({**dict(self.limits), **own.model_dump(exclude_none=True)})


def require_approved(recipe: Recipe) -> None:
    """Check that somebody approved exactly this recipe."""
    if recipe.is_approved:
        return
    state = "was changed since it was approved" if recipe.approval else "is not approved"
    raise NotApproved(
        f"recipe {recipe.name}, version {recipe.version}, {state}; run ps4rig station approve, or "
        "approve it in the panel of a run with --collect"
    )
