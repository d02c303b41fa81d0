"""Simulated calibration targets: plate, spheres, checkerboard, lens cap.

A target is placed like a texture: its centre is at `shift_px` = (0, 0), and it rotates about the
centre of the frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from classify.base.arrays import Floats
from classify.base.errors import InputError

from .random_fields import gaussian, mulvaney
from .render import Gloss, SceneImages
from .surfaces import PeriodicSurface, Surface, SurfacePatch, View, from_centre

TARGETS = ("plate", "mirror_sphere", "matte_sphere", "checkerboard", "lens_cap")
CHECKERBOARD_CORNERS = (9, 6)
"""Inner corners of the checkerboard along x and y, as OpenCV counts them."""
_SPHERE_MM, SQUARE_MM = 20.0, 5.0
"""Default diameter of a sphere, and side of a square: a common ball bearing, and the example of
``ps4rig calibrate scale``."""

# Reflectances of a sheet of paper, of the matt ball, and of black card.
_WHITE, _BLACK = 0.9, 0.05
# Spread of the reflectance of office paper between pixels, and of its slopes.
_GRAIN, _GRAIN_SLOPE = 0.015, 0.01
_SHEET_SLOPE = 0.01  # 0.6 degrees: a card that is not quite flat on the stage
_DUST_SPACING_PX = 80.0
_TILE_PX = 512
# Without a scale: diameter of a sphere and width of a board as shares of the frame's shorter side.
_SPHERE_SHARE, _BOARD_SHARE = 0.6, 0.8
# The image of an LED on the ball is as bright as a white surface that faces the LED. An LED of 5 mm
# at 110 mm has an angular radius of 1.3 degrees, and normals within half of that reflect it.
_MIRROR = Gloss(strength=1.0, exponent=2.0 / math.radians(1.3) ** 2)
_CHROME = 0.6  # reflectance of polished chrome or steel
# Light that the walls of the shroud return, as a share of an LED's.
_WALLS = 0.01
_CARD_SHARE = 1.5  # side of the card on which a ball rests, in sides of the frame
_CAMERA_DEG, _CAMERA_LIGHT = 8.0, 0.1  # angular radius of the lens, and its light in the mirror


def target_named(
    name: str,
    field_px: tuple[int, int],
    seed: int,
    mm_per_px: float | None = None,
    size_mm: float | None = None,
) -> Surface:
    """Make one of `TARGETS` for a frame of `field_px` (height, width)."""
    if name == "plate":
        return Plate(seed)
    if name == "lens_cap":
        return _Checkerboard(1.0, white=0.0, black=0.0)
    is_board = name == "checkerboard"
    columns = CHECKERBOARD_CORNERS[0] + 1
    if mm_per_px is not None:
        size_px = (size_mm or (SQUARE_MM if is_board else _SPHERE_MM)) / mm_per_px
    elif is_board:
        size_px = _BOARD_SHARE * min(field_px) / columns
    else:
        size_px = _SPHERE_SHARE * min(field_px)
    # The corners of a board must be visible, not its outer squares.
    width_px = (columns - 2) * size_px if is_board else size_px
    if not (width_px < min(field_px) and size_px >= 2.0):
        raise InputError(
            f"surface {name}: {width_px:.0f} px wide in a frame of {field_px[1]} x {field_px[0]} "
            "px; set simulation.mm_per_px or simulation.placement.size_mm"
        )
    if is_board:
        return _Checkerboard(size_px)
    return Sphere(0.5 * size_px, mirror=name == "mirror_sphere")


class Plate:
    """A white matt sheet with grain and dust, slightly tilted; every seed is another sheet."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        height = gaussian(mulvaney(0.2))(rng, _TILE_PX)
        sheet = PeriodicSurface.from_height(height, np.ones_like(height), "plate")
        height *= _GRAIN_SLOPE / max(float(sheet.p.std()), float(sheet.q.std()))
        albedo = _WHITE * (1.0 + _GRAIN * rng.standard_normal(height.shape)) * _dust(rng)
        self._grain = PeriodicSurface.from_height(height, albedo, "plate").band_limited()

    @property
    def relief_px(self) -> float:
        """Height of the grain; the tilt of a plane casts no shadow."""
        return self._grain.relief_px

    def patch(self, view: View) -> SurfacePatch:
        """A piece of the sheet; the centre of the frame is in the plane of the part."""
        grain = self._grain.patch(view)
        angle = math.radians(view.rotate_deg)
        p, q = (np.float32(_SHEET_SLOPE * f(angle)) for f in (math.cos, math.sin))
        x, y = from_centre(view.side_px)
        return SurfacePatch(grain.height + p * x + q * y, grain.p + p, grain.q + q, grain.albedo)


@dataclass(frozen=True)
class Sphere:
    """A ball at rest on black card, which lies in the plane of the part."""

    radius_px: float
    mirror: bool

    @property
    def relief_px(self) -> float:
        """0, because a sphere outside the frame is not rendered."""
        return 0.0

    @property
    def gloss(self) -> Gloss | None:
        """The images of the LEDs on a mirror."""
        return _MIRROR if self.mirror else None

    def patch(self, view: View) -> SurfacePatch:
        """The upper half of the ball, on a vertical cylinder that replaces the lower half."""
        x, y = view.part_coordinates()
        squared = self.radius_px**2 - x * x - y * y
        is_ball = squared > 0.0
        # The height of the upper half; a pixel at the outline would have an infinite slope.
        z = np.where(is_ball, np.sqrt(np.maximum(squared, 1e-4 * self.radius_px**2)), np.inf)
        height = np.where(is_ball, self.radius_px + z, 0.0) * view.magnification
        cos, sin = math.cos(math.radians(view.rotate_deg)), math.sin(math.radians(view.rotate_deg))
        p, q = (cos * -x - sin * -y) / z, (sin * -x + cos * -y) / z
        albedo = np.where(is_ball, 0.0 if self.mirror else _WHITE, _BLACK)
        maps = [plane.astype(np.float32) for plane in (height, p, q, albedo)]
        return SurfacePatch(maps[0], maps[1], maps[2], maps[3], plane_px=0.0)

    def reflecting_room(self, scene: SceneImages, ambient: float) -> SceneImages:
        """Add what a mirror reflects besides the LEDs: the room, the dark camera and the card."""
        if not self.mirror:
            return scene
        nz_squared = 1.0 / (1.0 + scene.p**2 + scene.q**2)
        # The direction that a pixel sees: 2 (n . v) n - v with v = (0, 0, 1).
        x, y, z = -2.0 * scene.p * nz_squared, -2.0 * scene.q * nz_squared, 2.0 * nz_squared - 1.0
        # A room that is brighter upwards in the image, with a window at the upper left.
        room = 1.0 + 0.5 * y + 3.0 * ((abs(x + 0.6) < 0.15) & (abs(y - 0.5) < 0.2))
        room = np.where(z > math.cos(math.radians(_CAMERA_DEG)), _CAMERA_LIGHT, room)
        is_ball, side_px = scene.albedo == 0.0, len(scene.albedo)
        # Length of a ray that goes down from the ball to the plane of the card.
        ray_px = self.radius_px * (1.0 + np.sqrt(nz_squared)) / np.maximum(-z, 1e-6)
        beside_x, beside_y = (
            np.abs(start + ray_px * step) > 0.5 * _CARD_SHARE * side_px
            for start, step in zip(from_centre(side_px), (x, y), strict=True)
        )
        card = (z < 0.0) & ~beside_x & ~beside_y
        lit_card = scene.lights.max(axis=(1, 2), where=~is_ball, initial=0.0)[:, None, None]
        lights = np.where(card, lit_card, np.float32(_WALLS) * room.astype(np.float32))
        dark = np.where(card, _BLACK, room).astype(np.float32)
        reflected = np.float32(_CHROME) * is_ball
        return replace(
            scene,
            lights=scene.lights + reflected * lights,
            ambient=scene.ambient + reflected * np.float32(ambient) * dark,
        )


@dataclass(frozen=True)
class _Checkerboard:
    """Black squares on a flat white sheet, `CHECKERBOARD_CORNERS` inner corners."""

    square_px: float
    white: float = _WHITE
    black: float = _BLACK

    @property
    def relief_px(self) -> float:
        """0: the board is flat."""
        return 0.0

    def patch(self, view: View) -> SurfacePatch:
        """The board; its edges are one pixel wide, for corners at fractions of a pixel."""
        axes = view.part_coordinates()
        contrast, inside = np.ones(()), np.ones((), np.bool_)  # contrast: 1 is white, -1 is black
        for along, corners in zip(axes, CHECKERBOARD_CORNERS, strict=True):
            # In squares; corners are at whole numbers.
            square = along / self.square_px + 0.5 * (corners - 1)
            to_edge_px = (
                (0.5 - np.abs(np.mod(square, 1.0) - 0.5)) * self.square_px * view.magnification
            )
            colour = np.where(np.mod(np.floor(square), 2.0) == 0.0, 1.0, -1.0)
            contrast = contrast * colour * np.minimum(2.0 * to_edge_px, 1.0)
            inside = inside & (square > -1.0) & (square < corners)
        whiteness = np.where(inside, 0.5 + 0.5 * contrast, 1.0)
        albedo = np.asarray(self.black + (self.white - self.black) * whiteness, np.float32)
        flat = np.zeros_like(albedo)
        return SurfacePatch(flat, flat, flat, albedo)


def _dust(rng: np.random.Generator) -> Floats:
    """(_TILE_PX, _TILE_PX) share of the light that is left by specks of dust, Gaussian spots."""
    transmission = np.ones((_TILE_PX, _TILE_PX))
    count = round((_TILE_PX / _DUST_SPACING_PX) ** 2)
    window = np.arange(-8, 9)  # four standard deviations of the largest speck
    for row, col in rng.uniform(0.0, _TILE_PX, (count, 2)):
        radius_px, depth = rng.uniform(0.7, 2.0), rng.uniform(0.2, 0.7)
        rows, cols = window + round(row), window + round(col)
        squared = (rows[:, None] - row) ** 2 + (cols - col) ** 2
        tile = np.ix_(rows % _TILE_PX, cols % _TILE_PX)
        transmission[tile] *= 1.0 - depth * np.exp(-0.5 * squared / radius_px**2)
    return transmission
