"""A solved surface with the maps that follow from its gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from classify import (
    Lighting,
    Roughness,
    SurfaceEstimate,
    integrate_gradients,
    local_relief,
    relight,
    surface_curvature,
    surface_roughness,
)
from classify.base.errors import InputError
from classify.surface.estimate import FloatMap

# From the upper left, as viewers expect, and between two lights of the ring.
RELIT_LIGHT = Lighting.from_angles([135.0], 45.0)


@dataclass(frozen=True, eq=False)
class SurfaceMaps:
    """The maps that `ps4rig solve` writes and shows: (H, W) float32, lengths in `length_unit`."""

    surface: SurfaceEstimate
    normals: FloatMap  # (H, W, 3), unit length
    height: FloatMap  # from the gradients alone, zero mean
    raised: FloatMap  # height above the surroundings, negative if indented
    mean_curvature: FloatMap  # 1/length
    gaussian_curvature: FloatMap  # 1/length^2
    relit: FloatMap  # under the distant `light`, without cast shadow, in units of the albedo
    light: Lighting
    roughness: Roughness | None  # None if no pixel is valid
    mm_per_px: float | None

    @property
    def length_unit(self) -> str:
        """Unit of height and, inverted, of curvature: mm if the scale is known, else px."""
        return "px" if self.mm_per_px is None else "mm"

    def known(self, values: FloatMap) -> FloatMap:
        """`values`, (H, W) or (H, W, C), with NaN where the surface is not valid."""
        valid = self.surface.valid.reshape(self.surface.shape + (1,) * (values.ndim - 2))
        return np.where(valid, values, np.float32(np.nan)).astype(np.float32, copy=False)

    @classmethod
    def of(
        cls,
        surface: SurfaceEstimate,
        light: Lighting = RELIT_LIGHT,
        mm_per_px: float | None = None,
    ) -> SurfaceMaps:
        if len(light) != 1:
            raise InputError(f"relit under {len(light)} lights; give one")
        height = integrate_gradients(surface.p, surface.q)
        curvature = surface_curvature(surface)
        roughness = surface_roughness(surface, height) if surface.valid.any() else None
        per_px = np.float32(1.0 if mm_per_px is None else mm_per_px)
        height *= per_px
        return cls(
            surface=surface,
            normals=surface.normals,
            height=height,
            raised=local_relief(height, surface.valid),
            mean_curvature=curvature.mean / per_px,
            gaussian_curvature=curvature.gaussian / per_px**2,
            relit=relight(surface, light)[0],
            light=light,
            roughness=roughness,
            mm_per_px=mm_per_px,
        )
