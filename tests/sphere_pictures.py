"""Pictures of spheres in a room under one light at a time, rendered from the geometry alone."""

from dataclasses import dataclass, field
from typing import Literal

import cv2
import numpy as np

from classify.lighting import light_vectors

Background = Literal["black", "cloth", "clutter", "sheet"]
_SUPERSAMPLED = 3


@dataclass(frozen=True)
class Picture:
    """A sphere before a camera, and the faults of the pictures of it."""

    directions: np.ndarray  # (N, 3) towards the lights
    width: int = 320
    height: int = 240
    centre: tuple[float, float] = (0.0, 0.0)  # px right and up of the middle of the frame
    radius: float = 80.0
    light_radius_deg: float = 2.5
    light: float = 30.0  # radiance of a light; 1 is full scale
    room: float = 0.25  # mean radiance of the room
    bounce: float = 0.15  # mean radiance that each light adds to the room
    unevenness: float = 0.0  # share of the bounce opposite to the light, less on its side
    background: Background = "clutter"
    blur: float = 0.7
    noise: float = 0.004
    gamma: float = 1.0
    jpeg: int | None = None
    focal: float | None = None
    seed: int = 0
    levels: np.ndarray = field(default_factory=lambda: np.ones(1))

    def rays(self) -> np.ndarray:
        """(h, w, 3) unit vectors from the camera, on a grid `_SUPERSAMPLED` times as fine."""
        step = 1.0 / _SUPERSAMPLED
        x = (np.arange(self.width * _SUPERSAMPLED) + 0.5) * step - 0.5 * self.width
        y = 0.5 * self.height - (np.arange(self.height * _SUPERSAMPLED) + 0.5) * step
        return np.stack(np.meshgrid(x, y), axis=-1)

    def normals(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Normals, unit vectors to the camera, and where the sphere is."""
        grid = self.rays()
        if self.focal is None:
            n = (grid - np.array(self.centre)) / self.radius
            squared = (n**2).sum(axis=-1)
            z = np.sqrt(np.maximum(1.0 - squared, 0.0))
            normals = np.concatenate([n, z[..., None]], axis=-1)
            return normals, np.broadcast_to([0.0, 0.0, 1.0], normals.shape), squared < 1.0
        rays = np.concatenate([grid, np.full((*grid.shape[:2], 1), -self.focal)], axis=-1)
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        # A sphere of this radius on the plane that is seen at one px per px.
        middle = np.array([*self.centre, -(self.focal - self.radius)])
        along = rays @ middle
        inside = along**2 - middle @ middle + self.radius**2
        distance = along - np.sqrt(np.maximum(inside, 0.0))
        normals = (rays * distance[..., None] - middle) / self.radius
        return normals, -rays, inside > 0.0

    def images(self, kind: Literal["mirror", "matte"] = "mirror") -> tuple[np.ndarray, np.ndarray]:
        """(N, H, W) uint8 pictures, and the (H, W) true mask."""
        rng = np.random.default_rng(self.seed)
        normals, views, on_sphere = self.normals()
        room = Room(rng)
        outside = self._outside(rng, normals.shape[:2])
        levels = np.broadcast_to(self.levels, len(self.directions))
        towards = 2.0 * (normals * views).sum(-1, keepdims=True) * normals - views
        reflected = room.radiance(towards)
        pictures = []
        for direction, level in zip(self.directions, levels, strict=True):
            if kind == "mirror":
                near = towards @ direction > np.cos(np.radians(self.light_radius_deg))
                bounce = self.bounce * level * (1.0 - self.unevenness * (towards @ direction))
                ball = reflected * (self.room + bounce) + 0.6 * self.light * near
            else:
                ball = 0.8 * level * np.maximum(normals @ direction, 0.0) + 0.3 * self.room
            behind = outside * (self.room + level * direction[2])
            fine = np.where(on_sphere, ball, behind).astype(np.float32)
            fine = np.minimum(fine, 40.0)
            size = (self.width, self.height)
            image = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
            if self.blur:
                image = cv2.GaussianBlur(image, (0, 0), self.blur)
            image = image + self.noise * rng.standard_normal(image.shape)
            image = np.clip(image, 0.0, 1.0) ** (1.0 / self.gamma)
            eight = np.rint(255.0 * image).astype(np.uint8)
            if self.jpeg is not None:
                coded = cv2.imencode(".jpg", eight, [cv2.IMWRITE_JPEG_QUALITY, self.jpeg])[1]
                eight = cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE)
            pictures.append(eight)
        share = cv2.resize(on_sphere.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        return np.stack(pictures), share > 0.5

    def _outside(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        if self.background == "black":
            return np.full(shape, 0.002, np.float32)
        if self.background == "sheet":
            return np.full(shape, 0.7, np.float32)
        grain = rng.standard_normal((self.height, self.width)).astype(np.float32)
        grain = cv2.resize(cv2.GaussianBlur(grain, (0, 0), 1.0), shape[::-1])
        if self.background == "cloth":
            return np.clip(0.2 * (1.0 + 0.5 * grain), 0.0, None)
        image = np.full(shape, 0.3, np.float32)
        for _ in range(30):
            corner = rng.integers(0, shape[::-1])
            size = rng.integers(10, max(shape) // 3, 2)
            angle, value = rng.uniform(0, 180), rng.uniform(0.02, 0.8)
            box = cv2.boxPoints((tuple(map(float, corner)), tuple(map(float, size)), angle))
            cv2.fillPoly(image, [box.astype(np.int32)], float(value))
        return np.clip(image * (1.0 + 0.1 * grain), 0.0, None)


class Room:
    """Radiance of a room by direction: walls, a dark floor, windows, with mean near 1."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.axes = rng.standard_normal((24, 3))
        self.axes /= np.linalg.norm(self.axes, axis=1, keepdims=True)
        self.sizes = np.cos(np.radians(rng.uniform(4.0, 25.0, 24)))
        self.values = rng.uniform(0.1, 2.0, 24)

    def radiance(self, towards: np.ndarray) -> np.ndarray:
        radiance = 0.6 + 0.4 * towards[..., 2] + 0.3 * np.sin(3.0 * towards[..., 0])
        for axis, size, value in zip(self.axes, self.sizes, self.values, strict=True):
            radiance = np.where(towards @ axis > size, value, radiance)
        return radiance


def scattered_lights(count: int, seed: int, largest_slant_deg: float = 60.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    slants = np.degrees(np.arccos(rng.uniform(np.cos(np.radians(largest_slant_deg)), 1.0, count)))
    return light_vectors(rng.uniform(0.0, 360.0, count), slants)
