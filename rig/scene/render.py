"""Ideal images of a surface under each light: Lambertian shading, attached and cast shadow."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from classify.errors import InputError
from classify.lighting import Lighting
from classify.relief.shadows import cast_shadow

from .surfaces import FloatImage, PeriodicSurface, SurfacePatch

AMBIENT = 0.02
"""Default ambient light as a share of the light of one LED: what a shrouded rig lets in."""


@dataclass(frozen=True, eq=False)
class SceneImages:
    """Images of one surface under N lights, and its true gradients and albedo.

    A white surface that faces a light has the value 1.
    """

    lights: FloatImage  # (N, H, W), the light that each LED alone adds at full level
    ambient: FloatImage  # (H, W), the light without any LED; not part of `lights`
    shadowed: npt.NDArray[np.bool_]  # (N, H, W), in attached or cast shadow of each light
    p: FloatImage
    q: FloatImage
    albedo: FloatImage

    def cropped(self, height_px: int, width_px: int) -> SceneImages:
        """Cut the middle of the images, for a camera whose frames are not square."""
        rows, cols = self.albedo.shape
        if not (1 <= height_px <= rows and 1 <= width_px <= cols):
            raise InputError(f"{height_px} x {width_px} px cannot be cut from {rows} x {cols}")
        top, left = (rows - height_px) // 2, (cols - width_px) // 2
        part = (..., slice(top, top + height_px), slice(left, left + width_px))
        return SceneImages(*(getattr(self, field.name)[part] for field in fields(self)))

    def without_shadow(self, lighting: Lighting) -> SceneImages:
        """The same surface in light that passes through it: negative light where n . l < 0.

        Lambert's law then holds at every pixel, as in the experiments without shadow of the
        literature. `lighting` is that of the rendering.
        """
        reflectance = _reflectance(self.p, self.q, self.albedo)
        lights = np.stack([
            _cosine(self.p, self.q, direction) * reflectance * np.float32(intensity)
            for direction, intensity in zip(lighting.directions, lighting.intensities, strict=True)
        ])  # fmt: skip
        return replace(self, lights=lights, shadowed=np.zeros_like(self.shadowed))


def render_scene(
    patch: SurfacePatch, lighting: Lighting, ambient: float = AMBIENT, margin_px: int = 0
) -> SceneImages:
    """Render a patch: albedo max(n . l, 0) intensity, and 0 in cast shadow.

    Parameters
    ----------
    patch
        Surface of (H + 2 margin_px, W + 2 margin_px).
    lighting
        Distant lights, fixed to the rig: they do not rotate with the surface.
    ambient
        Level of the even light that reaches every point without shading: albedo * ambient.
    margin_px
        Width of a border of the patch that casts shadows but is outside the images.

    Raises
    ------
    InputError
        For a margin that leaves no pixel, or a negative ambient level.
    """
    if not 0 <= 2 * margin_px < min(patch.height.shape):
        raise InputError(f"a margin of {margin_px} px leaves nothing of {patch.height.shape}")
    if not (math.isfinite(ambient) and ambient >= 0.0):
        raise InputError(f"ambient level {ambient} must be 0 or more")
    rows, cols = (slice(margin_px, side - margin_px) for side in patch.height.shape)
    p, q, albedo = (np.ascontiguousarray(x[rows, cols]) for x in (patch.p, patch.q, patch.albedo))
    reflectance = _reflectance(p, q, albedo)
    images = np.empty((len(lighting), *p.shape), np.float32)
    shadowed = np.empty(images.shape, np.bool_)
    for index, direction in enumerate(lighting.directions):
        image = _cosine(p, q, direction)
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
    """Render a square frame of a surface, shifted and rotated, with shadows from outside it.

    The margin around the frame is as wide as the longest shadow that the relief can cast, but not
    wider than the frame. For parameters and errors see `PeriodicSurface.patch` and `render_scene`.
    """
    reach_px = surface.relief_px * math.tan(math.radians(float(lighting.slants_deg.max())))
    margin_px = min(math.ceil(reach_px), size_px)
    patch = surface.patch(size_px, rotate_deg, shift_px, margin_px)
    return render_scene(patch, lighting, ambient, margin_px)


def _cosine(p: FloatImage, q: FloatImage, direction: npt.NDArray[np.float64]) -> FloatImage:
    """(n . l) sqrt(1 + p^2 + q^2), of either sign."""
    x, y, z = direction.astype(np.float32)
    return np.asarray(z - x * p - y * q, np.float32)


def _reflectance(p: FloatImage, q: FloatImage, albedo: FloatImage) -> FloatImage:
    return np.asarray(albedo / np.sqrt(1.0 + p * p + q * q), np.float32)
