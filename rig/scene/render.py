"""Images of a surface under each light: shading, shadow and gloss, and the faults of a lens."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from classify import InputError, Lighting
from classify.base.arrays import BoolArray, FloatMap, Floats
from classify.relief.relighting import cast_shadow

from .surfaces import Surface, SurfacePatch, View

_AMBIENT = 0.02
"""Default ambient light as a share of the light of one LED: what a shrouded rig lets in."""

_Vector = tuple[FloatMap | np.float32, FloatMap | np.float32, FloatMap | np.float32]
"""x, y and z of a direction, the same at every pixel or of shape (H, W)."""

DISTANT = math.inf
"""Distance of lights whose direction and strength are the same at every point."""


class Gloss(NamedTuple):
    """Blinn-Phong lobe: strength * (n . h)^exponent, h halfway between light and camera."""

    strength: float
    exponent: float


@dataclass(frozen=True, eq=False)
class SceneImages:
    """Images of a surface under N lights, and its true gradients; 1 is white facing a light."""

    lights: FloatMap  # (N, H, W), the light that each LED alone adds at full level
    ambient: FloatMap  # (H, W), the light without any LED; not part of `lights`
    shadowed: BoolArray  # (N, H, W), in attached or cast shadow of each light
    p: FloatMap
    q: FloatMap
    albedo: FloatMap

    def cropped(self, height_px: int, width_px: int) -> SceneImages:
        """Cut the middle of the images, for a camera whose frames are not square."""
        rows, cols = self.albedo.shape
        if not (1 <= height_px <= rows and 1 <= width_px <= cols):
            raise InputError(f"{height_px} x {width_px} px cannot be cut from {rows} x {cols}")
        top, left = (rows - height_px) // 2, (cols - width_px) // 2
        window = (..., slice(top, top + height_px), slice(left, left + width_px))
        return SceneImages(*(getattr(self, field.name)[window] for field in fields(self)))

    def without_shadow(self, lighting: Lighting) -> SceneImages:
        """The same surface by Lambert's law everywhere, with negative light where n . l < 0."""
        reflectance = _reflectance(self.p, self.q, self.albedo)
        lights = np.stack([
            _cosine(self.p, self.q, tuple(direction)) * reflectance * intensity
            for direction, intensity in zip(
                lighting.directions.astype(np.float32),
                lighting.intensities.astype(np.float32),
                strict=True,
            )
        ])  # fmt: skip
        return replace(self, lights=lights, shadowed=np.zeros_like(self.shadowed))


def render_scene(
    patch: SurfacePatch,
    lighting: Lighting,
    ambient: float = _AMBIENT,
    margin_px: int = 0,
    *,
    led_distance_px: npt.ArrayLike = DISTANT,
    lobe_exponent: float = 0.0,
    gloss: Gloss | None = None,
) -> SceneImages:
    """Render a patch: albedo max(n . l, 0) intensity, and 0 in cast shadow."""
    # The border of `margin_px` casts shadows only. Light of `led_distance_px`, one or (N,), falls
    # off with the square of the distance and as cos^m (`lobe_exponent`; 1 is Lambert's law) about
    # an axis to the centre of the frame.
    if not 0 <= 2 * margin_px < min(patch.height.shape):
        raise InputError(f"a margin of {margin_px} px leaves nothing of {patch.height.shape}")
    if not (math.isfinite(ambient) and ambient >= 0.0):
        raise InputError(f"ambient level {ambient} must be 0 or more")
    rows, cols = (slice(margin_px, side - margin_px) for side in patch.height.shape)
    p, q, albedo = (np.ascontiguousarray(x[rows, cols]) for x in (patch.p, patch.q, patch.albedo))
    height = patch.height[rows, cols]
    reflectance = _reflectance(p, q, albedo)
    images = np.empty((len(lighting), *p.shape), np.float32)
    shadowed = np.empty(images.shape, np.bool_)
    distances_px = np.broadcast_to(np.asarray(led_distance_px, np.float64), len(lighting))
    above_plane = height - (height.mean() if patch.plane_px is None else patch.plane_px)
    for index, direction in enumerate(lighting.directions):
        towards, fall_off = _point_light(
            direction, float(distances_px[index]), above_plane, lobe_exponent
        )
        image = _cosine(p, q, towards)
        np.less_equal(image, 0.0, out=shadowed[index])
        shadowed[index] |= cast_shadow(patch.height, direction)[rows, cols]
        image *= reflectance
        if gloss is not None:
            image += _lobe(p, q, towards, gloss)
        image *= np.float32(lighting.intensities[index]) * fall_off
        images[index] = np.where(shadowed[index], np.float32(0.0), image)
    return SceneImages(images, albedo * np.float32(ambient), shadowed, p, q, albedo)


def render_frame(
    surface: Surface,
    lighting: Lighting,
    size_px: int,
    rotate_deg: float = 0.0,
    shift_px: tuple[float, float] = (0.0, 0.0),
    ambient: float = _AMBIENT,
    *,
    magnification: float = 1.0,
    led_distance_px: npt.ArrayLike = DISTANT,
    lobe_exponent: float = 0.0,
    gloss: Gloss | None = None,
) -> SceneImages:
    """Render a square frame of a shifted, rotated surface; shadows may enter it."""
    reach_px = surface.relief_px * math.tan(math.radians(float(lighting.slants_deg.max())))
    margin_px = min(math.ceil(magnification * reach_px), size_px)
    patch = surface.patch(View(size_px, rotate_deg, shift_px, margin_px, magnification))
    return render_scene(
        patch,
        lighting,
        ambient,
        margin_px,
        led_distance_px=led_distance_px,
        lobe_exponent=lobe_exponent,
        gloss=gloss,
    )


def _point_light(
    direction: Floats,
    distance_px: float,
    height: FloatMap,
    lobe_exponent: float,
) -> tuple[_Vector, FloatMap | np.float32]:
    """Unit vector towards a light from points, and strength relative to the centre."""
    if math.isinf(distance_px):
        x, y, z = direction.astype(np.float32)
        return (x, y, z), np.float32(1.0)
    rows, cols = height.shape
    x = direction[0] * distance_px - (np.arange(cols) - 0.5 * (cols - 1))
    y = direction[1] * distance_px - (0.5 * (rows - 1) - np.arange(rows))[:, None]
    z = direction[2] * distance_px - height
    if not (distance_px > 0.0 and z.min() > 0.0):
        raise InputError(f"lights {distance_px:g} px away are not above the whole surface")
    distance = np.sqrt(x * x + y * y + z * z)
    fall_off = (distance_px / distance) ** 2
    if lobe_exponent != 0.0:
        axis_cosine = (direction[0] * x + direction[1] * y + direction[2] * z) / distance
        fall_off = fall_off * np.maximum(axis_cosine, 0.0) ** lobe_exponent
    x, y, z, fall_off = (
        np.asarray(values, np.float32)
        for values in (x / distance, y / distance, z / distance, fall_off)
    )
    return (x, y, z), fall_off


def _cosine(p: FloatMap, q: FloatMap, towards: _Vector) -> FloatMap:
    """(n . l) sqrt(1 + p^2 + q^2), of either sign."""
    x, y, z = towards
    return np.asarray(z - x * p - y * q, np.float32)


def _lobe(p: FloatMap, q: FloatMap, towards: _Vector, gloss: Gloss) -> FloatMap:
    x, y, z = towards
    halfway = (x, y, z + np.float32(1.0))
    length = np.sqrt(2.0 * halfway[2])  # |l + v| with v = (0, 0, 1)
    cosine = _cosine(p, q, halfway) / (length * np.sqrt(1.0 + p * p + q * q))
    return np.asarray(gloss.strength * np.maximum(cosine, 0.0) ** gloss.exponent, np.float32)


def _reflectance(p: FloatMap, q: FloatMap, albedo: FloatMap) -> FloatMap:
    return np.asarray(albedo / np.sqrt(1.0 + p * p + q * q), np.float32)


@dataclass(frozen=True)
class Lens:
    """A lens with faults; the default has none."""

    blur_px: float = 0.0  # standard deviation of the Gaussian
    vignetting: float = 0.0  # missing share in the corners, by the square of the field radius

    def images(self, scene: SceneImages) -> SceneImages:
        """The images of a scene through this lens; slopes, albedo and shadow stay the true ones."""
        lights = np.stack([self._image(light) for light in scene.lights])
        return replace(scene, lights=lights, ambient=self._image(scene.ambient))

    def _image(self, ideal: FloatMap) -> FloatMap:
        image = ideal
        if self.blur_px > 0.0:
            blurred = cv2.GaussianBlur(ideal, (0, 0), self.blur_px)
            image = np.asarray(blurred, np.float32)
        sides = np.array(ideal.shape, np.float64) - 1.0
        # Coordinates whose squared length is 2 in the corners.
        scales = (sides / np.sqrt(np.mean(sides**2))).astype(np.float32)
        rows, cols = (
            scale * np.linspace(-1.0, 1.0, side, dtype=np.float32)
            for side, scale in zip(ideal.shape, scales, strict=True)
        )
        darkening = np.float32(0.5 * self.vignetting) * (rows[:, None] ** 2 + cols**2)
        return np.asarray(image * (1.0 - darkening), np.float32)
