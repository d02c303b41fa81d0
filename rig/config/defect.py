"""A defect of the part below the simulated camera."""

from typing import Annotated, Literal, Self

from pydantic import Field, FiniteFloat, model_validator

from classify.base.models import Degrees, Section

DefectKind = Literal["scratch", "dent", "bump", "stain", "missing", "foreign"]
RELIEF_KINDS: tuple[DefectKind, ...] = ("scratch", "dent", "bump")
"""Kinds that change the relief alone, by `Defect.depth_px`."""

Place = Annotated[FiniteFloat, Field(ge=-1e6, le=1e6)]


class Defect(Section):
    """One defect, fixed to the part: it moves and rotates with it.

    Attributes
    ----------
    kind
        scratch: a groove between two ridges; dent, bump: smooth and round; stain: another albedo;
        missing: a patch without texture; foreign: another texture.
    x_px, y_px
        Middle of the defect, right and up from the point that is in the middle of the frame
        without a shift.
    size_px
        Length of a scratch, diameter of the others.
    width_px
        Width of a scratch, between the two places where it is as high as the surface.
    depth_px
        Depth of a scratch or a dent, height of a bump.
    angle_deg
        Anticlockwise: of a scratch, an irregular outline, a foreign texture.
    contrast
        Share by which a stain darkens the albedo; negative for a bright stain.
    surface
        Texture of a foreign patch, as that of the part.
    """

    kind: DefectKind
    x_px: Place = 0.0
    y_px: Place = 0.0
    size_px: float = Field(default=24.0, ge=2.0, le=2048.0)
    width_px: float = Field(default=3.0, ge=1.0, le=256.0)
    depth_px: float = Field(default=1.0, gt=0.0, le=256.0)
    angle_deg: Degrees = 0.0
    contrast: float = Field(default=0.4, ge=-1.0, le=1.0)
    surface: str | None = None

    @model_validator(mode="after")
    def _names_a_foreign_texture(self) -> Self:
        if self.kind == "foreign" and self.surface is None:
            raise ValueError("kind = 'foreign' needs `surface`, the texture of the patch")
        if self.kind != "foreign" and self.surface is not None:
            raise ValueError(f"kind = {self.kind!r} has no `surface`; only 'foreign' has one")
        return self
