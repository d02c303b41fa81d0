"""What the solvers find out about a surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .lighting import Lighting

__all__ = ["FloatMap", "SurfaceEstimate"]

FloatMap = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class SurfaceEstimate:
    """Gradient field, albedo and the maps that say how far to trust them, each (H, W).

    Attributes
    ----------
    p, q
        float32 gradients dz/dx and dz/dy (y up); 0 where no slope can be known.
    albedo
        float32, in units of the images (of full scale, where the solver was told it).
    residual
        float32 rms difference between the light images and a Lambertian surface, in units of the
        albedo: the fit to all lights for ps4, ps4_robust and least squares, this solution for the
        others. Shadow, highlight, noise and wrong light order all raise it.
    dropped
        uint8 index of the light left out of the solution, 255 where all were used. Where several
        were left out, or equally dark, it is the first of those, for rushmeier the lowest.
    shadow_count
        uint8 number of lights that give no more than half of what this solution predicts: cast
        and attached shadow together. Its mean over the number of lights is the shadow image
        integrated over all lights of the thesis's figure 9.7.
    saturated
        bool, true where any image reached full scale.
    specular
        bool, true where a highlight is suspected: a light gives clearly more than a Lambertian
        surface would. ps4_robust and drbohlav tell it from the lights that contradict each other,
        the others where a light exceeds the prediction of their solution by half; ps4, which
        trusts its three brightest, never does.
    repaired
        bool, true where fewer than three lights were left and the slope, and with one light or
        none the albedo too, was taken from the pixels around (ps4_robust only).
    valid
        bool, false where no slope can be known: fewer than three lights of those used are out of
        shadow (fewer than two for ps4_robust, which repairs), a light used is saturated, the
        solution faces away from the camera, or its standard error, from the noise of these
        images, exceeds 0.5.
    method
        Name of the solver.
    images
        (N, H, W) the images that were solved, as they were given, for what compares images and
        not surfaces; None for an estimate that comes from elsewhere.
    lighting
        The N lights of these images, with the intensities that they were found to have
        (ps4_robust; see `light_balance`).
    """

    p: FloatMap
    q: FloatMap
    albedo: FloatMap
    residual: FloatMap
    dropped: npt.NDArray[np.uint8]
    shadow_count: npt.NDArray[np.uint8]
    saturated: npt.NDArray[np.bool_]
    specular: npt.NDArray[np.bool_]
    repaired: npt.NDArray[np.bool_]
    valid: npt.NDArray[np.bool_]
    method: str
    images: npt.NDArray[Any] | None = None
    lighting: Lighting | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.p.shape
        return rows, columns

    @property
    def shadow_mask(self) -> npt.NDArray[np.bool_]:
        """(H, W) bool, true where at least one light is in shadow."""
        mask: npt.NDArray[np.bool_] = self.shadow_count > 0
        return mask

    @property
    def normals(self) -> FloatMap:
        """(H, W, 3) float32 unit normals (x right, y up, z to the camera)."""
        normals = np.empty((*self.shape, 3), dtype=np.float32)
        inverse = 1.0 / np.sqrt(1.0 + self.p**2 + self.q**2)
        normals[..., 0] = -self.p * inverse
        normals[..., 1] = -self.q * inverse
        normals[..., 2] = inverse
        return normals
