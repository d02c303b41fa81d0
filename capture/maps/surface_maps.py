"""A solved surface with the inputs of its maps."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from classify import (
    Lighting,
    Roughness,
    SurfaceEstimate,
    integrate_gradients,
    surface_curvature,
    surface_roughness,
)
from classify.base.arrays import Array, FloatMap
from classify.base.errors import InputError
from classify.relief.height import default_cutoff_px
from classify.relief.roughness import RoughnessUncertainty, roughness_uncertainty

if TYPE_CHECKING:
    from classify import Curvature

    from .views import MapKind

# From the upper left, as viewers expect, and between two lights of the ring.
RELIT_LIGHT = Lighting.from_angles([135.0], 45.0)


@dataclass(frozen=True, eq=False)
class SurfaceMaps:
    """A surface whose maps `ps4rig solve` writes and shows; lengths are in `length_unit`."""

    surface: SurfaceEstimate
    light: Lighting = RELIT_LIGHT  # of the relit map
    mm_per_px: float | None = None
    _computed: dict[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.light) != 1:
            raise InputError(f"relit under {len(self.light)} lights; give one")

    def values(self, kind: MapKind) -> Array:
        """(H, W) or (H, W, 3) values of a map; float32 values are NaN where invalid."""
        if kind.name not in self._computed:
            self._computed[kind.name] = kind.compute(self)
        values = self._computed[kind.name]
        if kind.is_mask:
            return values
        valid = self.surface.valid.reshape(self.surface.shape + (1,) * (values.ndim - 2))
        return np.where(valid, values, np.float32(np.nan)).astype(np.float32, copy=False)

    @cached_property
    def height(self) -> FloatMap:
        """Height from the gradients alone, zero mean."""
        height = integrate_gradients(self.surface.p, self.surface.q, self.surface.valid)
        height *= self.length_per_px
        return height

    @cached_property
    def curvature(self) -> Curvature:
        """Mean and Gaussian curvature per pixel."""
        return surface_curvature(self.surface)

    @cached_property
    def roughness(self) -> Roughness | None:
        """Roughness of the height; None if no pixel is valid."""
        if not self.surface.valid.any():
            return None
        return surface_roughness(self.surface, self.height / self.length_per_px)

    @cached_property
    def roughness_uncertainty(self) -> RoughnessUncertainty | None:
        """Uncertainty of the roughness; None for a surface without deviations."""
        if self.roughness is None or self.surface.p_sd is None:
            return None
        across_px = float(self.surface.shape[1] - 1)
        distances_px = [across_px]
        if self.mm_per_px is not None and 1.0 / self.mm_per_px < across_px:
            distances_px.insert(0, 1.0 / self.mm_per_px)
        return roughness_uncertainty(self.surface, self.roughness, tuple(distances_px))

    @property
    def tilts_deg(self) -> list[float]:
        lighting = self.surface.lighting
        return [] if lighting is None else lighting.tilts_deg.tolist()

    @property
    def length_unit(self) -> str:
        """Unit of height and, inverted, of curvature: mm if the scale is known, else px."""
        return "px" if self.mm_per_px is None else "mm"

    @property
    def length_per_px(self) -> np.float32:
        """Length units in a pixel."""
        return np.float32(1.0 if self.mm_per_px is None else self.mm_per_px)

    @property
    def words(self) -> dict[str, Any]:
        """Words of titles, captions and units."""
        relative = self.mm_per_px is None
        return {
            "length": self.length_unit,
            "relative": " (relative)" if relative else "",
            "unmeasured": ", not measured" if relative else "",
            "Height": "Relative height" if relative else "Height",
            "cutoff_px": default_cutoff_px(self.surface.shape),
            "tilt_deg": self.light.tilts_deg[0],
            "slant_deg": self.light.slants_deg[0],
        }
