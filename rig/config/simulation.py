"""The section ``[simulation]`` of ``rig.toml``, for simulated rigs: hardware, defects, faults."""

import math
from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from classify.base.models import Degrees, Section
from firmware_sim.faults import LedFault, LineFault, When

MAX_FRAMES_BACK = 4
"""Number of the simulated driver's buffers; a torn frame shows the old content of one."""


class FrameFault(Section):
    """A fault in frames."""

    kind: Literal[
        "dropped", "repeated_pixels", "repeated_frame", "torn", "black", "dark", "late",
        "stamped_late", "drift", "gone",
    ] = Field(
        description="repeated_pixels: with a new number and times; torn: rows of an earlier frame; "
        "black: all zero; dark: without light; drift: of the exposure; gone: no frame from then on"
    )  # fmt: skip
    row_share: float = Field(
        default=0.5,
        gt=0.0,
        lt=1.0,
        description="of a torn frame: where the earlier frame begins",
    )
    frames_back: int = Field(
        default=1, ge=1, le=MAX_FRAMES_BACK, description="of a torn frame, 1 to 4"
    )
    delay_ms: float = Field(
        default=10.0, ge=0.0, le=60_000.0, description="of late and stamped_late"
    )
    rate_per_s: float = Field(default=0.5, description="of drift: share of the exposure per second")
    when: When = Field(default=When(), description="as of a line")


class FaultPlan(Section):
    """Faults of a simulated rig, injected below the drivers.

    Attributes
    ----------
    seed
        Of all random faults.
    lines
        Of the serial line.
    leds
        In the light of the LEDs.
    frames
        In the camera's frames.
    """

    seed: int = Field(default=1, ge=0, lt=2**63)
    lines: tuple[LineFault, ...] = Field(default=(), strict=False)
    leds: tuple[LedFault, ...] = Field(default=(), strict=False)
    frames: tuple[FrameFault, ...] = Field(default=(), strict=False)


DefectKind = Literal["scratch", "dent", "bump", "stain", "missing", "foreign"]
RELIEF_KINDS: tuple[DefectKind, ...] = ("scratch", "dent", "bump")
"""Kinds of defects that change only the relief, by `Defect.depth_px`."""

_Place = Annotated[float, Field(ge=-1e6, le=1e6)]


class Defect(Section):
    """One defect, fixed to the part: it moves and rotates with it.

    Attributes
    ----------
    kind
        scratch: a groove between two ridges; dent, bump: smooth and round; stain: another albedo;
        missing: a patch without texture; foreign: another texture.
    x_px, y_px
        Middle of the defect, right and up from the centre of a frame with `shift_px` 0.
    size_px
        Length of a scratch, diameter of the others.
    width_px
        Width of a scratch at the height of the surface.
    depth_px
        Depth of a scratch or a dent, height of a bump.
    angle_deg
        Direction of a scratch, an irregular outline or a foreign texture, anticlockwise.
    contrast
        Share by which a stain darkens the albedo; negative for a bright stain.
    surface
        Texture of a foreign patch: synthetic texture, bundled material, or material folder.
    """

    kind: DefectKind
    x_px: _Place = 0.0
    y_px: _Place = 0.0
    size_px: float = Field(default=24.0, ge=2.0, le=2048.0)
    width_px: float = Field(default=3.0, ge=1.0, le=256.0)
    depth_px: float = Field(default=1.0, gt=0.0, le=256.0)
    angle_deg: Degrees = 0.0
    contrast: float = Field(default=0.4, ge=-1.0, le=1.0)
    surface: str | None = None

    @model_validator(mode="after")
    def _require_foreign_texture(self) -> Self:
        if self.kind == "foreign" and self.surface is None:
            raise ValueError("kind = 'foreign' needs `surface`, the texture of the patch")
        if self.kind != "foreign" and self.surface is not None:
            raise ValueError(f"kind = {self.kind!r} has no `surface`; only 'foreign' has one")
        return self


_PassTimeUs = Annotated[float, Field(ge=1.0, le=1e6)]
_Shift = Annotated[float, Field(ge=-1e6, le=1e6)]
_LedLevel = Annotated[float, Field(ge=0.01, le=100.0)]


class Placement(Section):
    """The part below the simulated camera, and its position.

    Attributes
    ----------
    surface
        Synthetic texture, bundled material, material folder, or calibration target.
    rotate_deg
        Anticlockwise, about the centre of the frame.
    shift_px
        Shift of the frame's centre over the periodic surface, right and up, before the rotation.
    seed
        Of the noise, and of the realisation of a synthetic texture or a plate.
    size_mm
        Diameter of a sphere, by default 20, or side of a square of the checkerboard, by default 5;
        needs `mm_per_px`, without which they are shares of the frame.
    defects
        In the order in which they happened to the part.
    """

    surface: str = "rock"
    rotate_deg: Degrees = 0.0
    shift_px: tuple[_Shift, _Shift] = Field(default=(0.0, 0.0), strict=False)
    seed: int = Field(default=1, ge=0, lt=2**63)
    size_mm: float | None = Field(default=None, ge=1e-3, le=1e4)
    defects: tuple[Defect, ...] = Field(default=(), strict=False, max_length=100)

    def defects_outside(self, width_px: int, height_px: int) -> Iterator[Defect]:
        """Yield the defects of which a frame of this size shows nothing."""
        cos, sin = math.cos(math.radians(self.rotate_deg)), math.sin(math.radians(self.rotate_deg))
        for defect in self.defects:
            right, up = defect.x_px - self.shift_px[0], defect.y_px - self.shift_px[1]
            x, y, reach = cos * right - sin * up, sin * right + cos * up, 0.5 * defect.size_px
            if abs(x) - reach > 0.5 * width_px or abs(y) - reach > 0.5 * height_px:
                yield defect


class SimulationConfig(Section):
    """Properties of the simulated hardware."""

    clock: Literal["virtual", "real"] = Field(
        default="virtual", description="real takes as long as the frames take"
    )
    ambient: float = Field(
        default=0.02, ge=0.0, le=1.0, description="ambient light, as a share of one LED's"
    )
    led_distance_px: float | None = Field(
        default=None, ge=16.0, le=1e6, description="from the centre of the frame; else distant LEDs"
    )
    led_levels: tuple[_LedLevel, ...] = Field(
        default=(), strict=False, description="true levels, which the rig is not told"
    )
    vignetting_percent: float = Field(
        default=0.0, ge=0.0, le=90.0, description="light missing in the corners"
    )
    response_gamma: float = Field(
        default=1.0, ge=0.2, le=5.0, description="pixel values are linear ones to 1 / gamma"
    )
    hot_pixels: int = Field(default=0, ge=0, le=10_000, description="number of them")
    mm_per_px: float | None = Field(
        default=None, ge=1e-5, le=100.0, description="for sizes of spheres and the checkerboard"
    )
    led_rise_ms: float = Field(default=0.5, gt=0.0, le=100.0, description="10 to 90 %")
    led_fall_ms: float = Field(default=0.3, gt=0.0, le=100.0, description="90 to 10 %")
    controller_turn_us: tuple[_PassTimeUs, _PassTimeUs] = Field(
        default=(50.0, 200.0),
        strict=False,
        description="shortest and longest pass of the controller's main loop",
    )
    readout_ms: float = Field(
        default=0.0, ge=0.0, le=10_000.0, description="of a rolling shutter: first row to last row"
    )
    stamp_lag_ms: float | None = Field(
        default=None,
        ge=-1000.0,
        le=1000.0,
        description="from the start of exposure to the stamp; else exact stamps",
    )
    stamp_jitter_ms: float = Field(
        default=0.0, ge=0.0, le=100.0, description="stamps are up to this much later"
    )
    placement: Placement = Field(default=Placement(), description="the part below the camera")
    faults: FaultPlan | None = Field(
        default=None, description="a file relative to rig.toml, or the same tables here"
    )
