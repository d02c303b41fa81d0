"""What an ideal camera sees of a surface under each light: Lambertian, with shadows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from classify.errors import InputError
from classify.lighting import Lighting
from classify.relief.shadows import cast_shadow

from .surfaces import FloatImage, PeriodicSurface, SurfacePatch

__all__ = ["SceneImages", "render_frame", "render_scene"]

AMBIENT = 0.02
"""Light that is there when no LED is on, as a share of what one LED gives."""


@dataclass(frozen=True, eq=False)
class SceneImages:
    """One surface under N lights, and the truth about it. 1.0 is a white surface facing a light.

    Parameters
    ----------
    lights
        (N, H, W) float32, what each light alone adds, at full LED output.
    ambient
        (H, W) float32, what is there without them; not part of `lights`.
    shadowed
        (N, H, W) bool, in attached or cast shadow of each light.
    p, q, albedo
        (H, W) float32, the truth.
    """

    lights: FloatImage
    ambient: FloatImage
    shadowed: npt.NDArray[np.bool_]
    p: FloatImage
    q: FloatImage
    albedo: FloatImage

    def cropped(self, height_px: int, width_px: int) -> SceneImages:
        """The middle of the images, for a camera whose frames are not square.

        Raises
        ------
        InputError
            If the images are smaller than that.
        """
        rows, cols = self.albedo.shape
        if not (1 <= height_px <= rows and 1 <= width_px <= cols):
            raise InputError(f"{height_px} x {width_px} px cannot be cut from {rows} x {cols}")
        top, left = (rows - height_px) // 2, (cols - width_px) // 2
        part = (..., slice(top, top + height_px), slice(left, left + width_px))
        return SceneImages(
            self.lights[part],
            self.ambient[part],
            self.shadowed[part],
            self.p[part],
            self.q[part],
            self.albedo[part],
        )


def render_scene(
    patch: SurfacePatch, lighting: Lighting, ambient: float = AMBIENT, margin_px: int = 0
) -> SceneImages:
    """The images of a patch: albedo max(n . l, 0) intensity, nothing where shadow is cast.

    Parameters
    ----------
    patch
        Surface of (H + 2 margin_px, W + 2 margin_px).
    lighting
        Distant lights; the rig's, whatever way the surface is turned.
    ambient
        Level of the even light that reaches every point without shading: albedo * ambient.
    margin_px
        This much on every side of the patch casts shadows but is not seen.

    Raises
    ------
    InputError
        For a margin that leaves nothing, or a negative ambient level.
    """
    if not 0 <= 2 * margin_px < min(patch.height.shape):
        raise InputError(f"a margin of {margin_px} px leaves nothing of {patch.height.shape}")
    if not (math.isfinite(ambient) and ambient >= 0.0):
        raise InputError(f"ambient level {ambient} must be 0 or more")
    rows, cols = (slice(margin_px, side - margin_px) for side in patch.height.shape)
    p, q, albedo = (np.ascontiguousarray(x[rows, cols]) for x in (patch.p, patch.q, patch.albedo))
    reflectance = albedo / np.sqrt(1.0 + p * p + q * q)
    images = np.empty((len(lighting), *p.shape), np.float32)
    shadowed = np.empty(images.shape, np.bool_)
    for index, direction in enumerate(lighting.directions):
        x, y, z = direction.astype(np.float32)
        image = z - x * p - y * q
        np.less_equal(image, 0.0, out=shadowed[index])
        shadowed[index] |= cast_shadow(patch.height, direction)[rows, cols]
        image *= reflectance
        image *= np.float32(lighting.intensities[index])
        images[index] = np.where(shadowed[index], np.float32(0.0), image)
    return SceneImages(images, albedo * np.float32(ambient), shadowed, p, q, albedo)


def render_frame(
    surface: PeriodicSurface,
    lighting: Lighting,
    size_px: int,
    rotate_deg: float = 0.0,
    shift_px: tuple[float, float] = (0.0, 0.0),
    ambient: float = AMBIENT,
) -> SceneImages:
    """A square frame of a surface, shifted and turned, with shadows from outside the frame.

    Surface is added around the frame as far as its relief can cast a shadow under the lowest
    light, but no further than the frame is wide. For the rest see `PeriodicSurface.patch` and
    `render_scene`.
    """
    reach_px = surface.relief_px * math.tan(math.radians(float(lighting.slants_deg.max())))
    margin_px = min(math.ceil(reach_px), size_px)
    patch = surface.patch(size_px, rotate_deg, shift_px, margin_px)
    return render_scene(patch, lighting, ambient, margin_px)
