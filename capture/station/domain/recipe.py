"""`Recipe`: the textures that pass and their limits; people approve its file."""

from collections.abc import Mapping
from typing import Annotated, Self

from pydantic import ConfigDict, Field, model_validator

from capture.base.names import Label, Name, Text
from capture.station.domain.errors import NotApproved
from classify.base.models import Section
from rig.set_file import fields_sha256

from .limits import GeneralLimits, Limits

_DIGITS = 8  # of a hash that is shown
_MAX_TEXTURES = 1000  # bounds the file; `station bench` measures a recipe with 30 textures

Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class Orientation(Section):
    """How a part must lie."""

    tolerance_deg: Annotated[float, Field(gt=0.0, le=180.0)] | None = Field(
        default=None, description="largest departure from reference_deg"
    )
    reference_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = Field(
        default=0.0, description="anticlockwise, with the zero of the taught parts"
    )
    full_turn: bool = Field(
        default=False, description="whether a part at reference_deg + 180 is wrong"
    )

    @property
    def period_deg(self) -> float:
        return 360.0 if self.full_turn else 180.0

    def deviation_deg(self, measured_deg: float, period_deg: float) -> float:
        """Return the departure of an orientation with this period, within half a period."""
        half_deg = 0.5 * period_deg
        return (measured_deg - self.reference_deg + half_deg) % period_deg - half_deg


class Region(Section):
    """Judged region of the image, in px: column and row of its top left corner, size."""

    x: int = Field(ge=0, le=32767, description="column of its corner")
    y: int = Field(ge=0, le=32767, description="row of its corner")
    width: int = Field(ge=16, le=32768, description="in px")
    height: int = Field(ge=16, le=32768, description="in px")

    def __str__(self) -> str:
        return f"{self.width} x {self.height} px at column {self.x}, row {self.y}"


class CameraSettings(Section):
    """Settings of the camera for this recipe; None leaves those of ``rig.toml``."""

    exposure_ms: Annotated[float, Field(gt=0.0, le=10_000.0)] | None = Field(
        default=None, description="instead of that in rig.toml"
    )
    gain: int | None = Field(
        default=None, ge=0, le=2**31 - 1, description="instead of that in rig.toml"
    )

    @property
    def of_camera(self) -> dict[str, float]:
        """The settings that replace those of ``[camera]`` in ``rig.toml``."""
        return self.model_dump(exclude_none=True)


class CalibrationRule(Section):
    """Whether a calibration is required, and the greatest age of its oldest part.

    The usual age is 365 days (ILAC-G24, OIML D 10).
    """

    required: bool = Field(
        default=False, description="whether a part without a calibration is an error"
    )
    max_age_days: int = Field(
        default=365, ge=1, le=36_500, description="greatest age of the calibration"
    )

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

    by: Text = Field(min_length=1, max_length=200, description="who approved it")
    utc: Text = Field(min_length=1, max_length=40, description="when")
    sha256: Sha256 = Field(description="hash of the recipe that was approved")


class Recipe(Section):
    """Which textures pass, with which limits, on which region, under which light."""

    model_config = ConfigDict(populate_by_name=True)

    name: Name = Field(description="that of the file")
    version: int = Field(default=1, ge=1, le=2**31 - 1, description="raised by each teaching")
    note: Text | None = Field(default=None, max_length=1000, description="for people")
    passes: tuple[Label, ...] = Field(
        alias="pass", max_length=_MAX_TEXTURES, strict=False, description="textures of good parts"
    )
    fails: tuple[Label, ...] = Field(
        default=(),
        alias="fail",
        max_length=_MAX_TEXTURES,
        strict=False,
        description="textures of known bad parts; those in neither list fail too",
    )
    orientation: Orientation = Field(
        default=Orientation(),
        description="how a part must lie; without tolerance_deg every orientation passes",
    )
    limits: GeneralLimits = Field(default=GeneralLimits(), description="limits of all textures")
    limits_of: Mapping[Label, Limits] = Field(
        default_factory=dict,
        description="limits of one texture, in `[limits_of.TEXTURE]`, in place of those above",
    )
    region: Region | None = Field(
        default=None, description="part of the image that is judged; teach again after a change"
    )
    light: CameraSettings = Field(
        default=CameraSettings(), description="settings of the camera for this recipe"
    )
    calibration: CalibrationRule = Field(
        default=CalibrationRule(), description="whether a calibration is required"
    )
    # Named in `fault_study.FAULTS`.
    acknowledged: tuple[Text, ...] = Field(
        default=(),
        max_length=100,
        strict=False,
        description="faults of a fifth of the frame that may pass",
    )
    taught: Sha256 | None = Field(default=None, description="hash of what teaching measured")
    approval: Approval | None = Field(default=None, description="written by ps4rig station approve")

    @model_validator(mode="after")
    def _textures_are_named_once(self) -> Self:
        named = [*self.passes, *self.fails]
        twice = next((texture for texture in named if named.count(texture) > 1), None)
        if twice is not None:
            raise ValueError(f"pass, fail: {twice!r} is named twice; name each texture once")
        other = next((texture for texture in self.limits_of if texture not in self.passes), None)
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
        """Return the limits of a texture: its own, and where it has none the general ones."""
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
