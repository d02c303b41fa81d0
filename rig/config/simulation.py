"""The section ``[simulation]`` of ``rig.toml``, for simulated rigs only."""

from typing import Annotated, Literal

from pydantic import Field, FiniteFloat

from classify.base.section import Degrees, Section

from .defect import Defect
from .fault_plan import FaultPlan

PassTime = Annotated[FiniteFloat, Field(ge=1.0, le=1e6)]
Shift = Annotated[FiniteFloat, Field(ge=-1e6, le=1e6)]
LedLevel = Annotated[FiniteFloat, Field(ge=0.01, le=100.0)]


class Placement(Section):
    """The part below the simulated camera, and its position.

    Attributes
    ----------
    surface
        A synthetic texture such as rock, a bundled material, a material folder, or a calibration
        target: plate, mirror_sphere, matte_sphere, checkerboard, lens_cap.
    rotate_deg
        Anticlockwise rotation of the surface about the centre of the frame.
    shift_px
        Shift of the frame's centre over the periodic surface (x right, y up), before the rotation.
    seed
        Seed of the noise, and of the realisation of a synthetic texture or of a plate.
    size_mm
        Diameter of a sphere, 20 by default, or side of a square of the checkerboard, 5 by default;
        needs `SimulationConfig.mm_per_px`, without which they are shares of the frame.
    defects
        Defects of the part, in the order in which they happened to it.
    """

    surface: str = "rock"
    rotate_deg: Degrees = 0.0
    shift_px: tuple[Shift, Shift] = Field(default=(0.0, 0.0), strict=False)
    seed: int = Field(default=1, ge=0, lt=2**63)
    size_mm: float | None = Field(default=None, ge=1e-3, le=1e4)
    defects: tuple[Defect, ...] = Field(default=(), strict=False, max_length=100)


class SimulationConfig(Section):
    """Properties of the simulated hardware."""

    clock: Literal["virtual", "real"] = "virtual"
    ambient: float = Field(default=0.02, ge=0.0, le=1.0)
    led_distance_px: float | None = Field(default=None, ge=16.0, le=1e6)
    led_levels: tuple[LedLevel, ...] = Field(default=(), strict=False)
    vignetting_percent: float = Field(default=0.0, ge=0.0, le=90.0)
    response_gamma: float = Field(default=1.0, ge=0.2, le=5.0)
    hot_pixels: int = Field(default=0, ge=0, le=10_000)
    mm_per_px: float | None = Field(default=None, ge=1e-5, le=100.0)
    led_rise_ms: float = Field(default=0.5, gt=0.0, le=100.0)
    led_fall_ms: float = Field(default=0.3, gt=0.0, le=100.0)
    controller_turn_us: tuple[PassTime, PassTime] = Field(default=(50.0, 200.0), strict=False)
    readout_ms: float = Field(default=0.0, ge=0.0, le=10_000.0)
    stamp_lag_ms: float | None = Field(default=None, ge=-1000.0, le=1000.0)
    stamp_jitter_ms: float = Field(default=0.0, ge=0.0, le=100.0)
    placement: Placement = Placement()
    faults: FaultPlan | None = None
