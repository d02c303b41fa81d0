"""A solved surface with the maps that follow from its gradients."""

from __future__ import annotations

from dataclasses import dataclass

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
from classify.errors import InputError
from classify.surface.estimate import FloatMap

# From the upper left, as viewers expect, and between two lights of the ring.
RELIT_LIGHT = Lighting.from_angles([135.0], 45.0)


@dataclass(frozen=True, eq=False)
class SurfaceMaps:
    """The maps that `ps4rig solve` writes and shows.

    Attributes
    ----------
    normals
        (H, W, 3) float32 unit normals.
    height
        (H, W) float32, px, relative: from the gradients alone, zero mean.
    raised
        (H, W) float32, px, relative: height above the surroundings, negative if indented.
    mean_curvature, gaussian_curvature
        (H, W) float32, 1/px and 1/px^2.
    relit
        (H, W) float32, the surface under the one distant `light` without cast shadows, in units
        of the albedo.
    roughness
        None if no pixel is valid.
    """

    surface: SurfaceEstimate
    normals: FloatMap
    height: FloatMap
    raised: FloatMap
    mean_curvature: FloatMap
    gaussian_curvature: FloatMap
    relit: FloatMap
    light: Lighting
    roughness: Roughness | None

    @classmethod
    def of(cls, surface: SurfaceEstimate, light: Lighting = RELIT_LIGHT) -> SurfaceMaps:
        """Compute all maps of a surface.

        Raises
        ------
        InputError
            If `light` is not one light.
        """
        if len(light) != 1:
            raise InputError(f"relit under {len(light)} lights; give one")
        height = integrate_gradients(surface.p, surface.q)
        curvature = surface_curvature(surface)
        return cls(
            surface=surface,
            normals=surface.normals,
            height=height,
            raised=local_relief(height, surface.valid),
            mean_curvature=curvature.mean,
            gaussian_curvature=curvature.gaussian,
            relit=relight(surface, light)[0],
            light=light,
            roughness=surface_roughness(surface, height) if surface.valid.any() else None,
        )
