"""Pictures of a white sheet under near LEDs, rendered with numpy alone."""

from dataclasses import dataclass, replace

import numpy as np

from classify.images import ImageStack
from classify.lighting import light_vectors

Array = np.ndarray


@dataclass(frozen=True)
class Plate:
    """A sheet of paper under LEDs; lengths are in half of the longer side of the frame.

    Attributes
    ----------
    lobe, aim
        Exponent of the strength of an LED at an angle to its axis, and where the axis points: to
        the middle of the frame or straight down.
    tilt
        Slopes dz/dx and dz/dy of the sheet before it is rotated.
    half_turns, grain, specks, waviness
        By how much the sheet is rotated, in quarter turns; rms of the reflectance of a pixel;
        number of specks of dust; reflectance that varies over the sheet.
    gloss, shine
        Strength and exponent of a lobe about the mirror direction, seen from a camera at ten.
    """

    positions: Array
    levels: tuple[float, ...] = (1.0, 0.9, 1.1, 0.95)
    shape: tuple[int, int] = (192, 192)
    lobe: float = 1.0
    aim: str = "centre"
    vignetting: float = 0.2
    tilt: tuple[float, float] = (0.0, 0.0)
    quarter_turns: int = 0
    grain: float = 0.02
    specks: int = 0
    waviness: float = 0.0
    noise: float = 0.003
    bits: int = 12
    brightest: float = 0.8
    gloss: float = 0.0
    shine: float = 30.0
    ambient: float = 0.0
    seed: int = 0

    @property
    def full_scale(self) -> float:
        return float(2**self.bits - 1)

    @property
    def positions_px(self) -> Array:
        return 0.5 * max(self.shape) * np.asarray(self.positions)

    def turned(self, quarter_turns: int) -> "Plate":
        """The same sheet, rotated."""
        return replace(self, quarter_turns=quarter_turns)

    @property
    def strengths(self) -> Array:
        """(N, H, W) light on a level sheet of reflectance 1: what a flat field contains."""
        return self._strengths((0.0, 0.0))

    @property
    def stack(self) -> ImageStack:
        rng = np.random.default_rng(self.seed + 100 * self.quarter_turns)
        p, q = self.tilt
        for _ in range(self.quarter_turns):
            p, q = -q, p
        light = self._strengths((p, q))
        light *= self.brightest / self._strengths((0.0, 0.0)).max()
        light += light.max() * self._gloss()
        light *= self._sheet()
        light += self.ambient
        light += self.noise * np.sqrt(np.maximum(light, 0.0)) * rng.standard_normal(light.shape)
        values = np.rint(np.clip(light, 0.0, 1.0) * self.full_scale)
        dtype = np.uint8 if self.bits == 8 else np.uint16
        ambient = np.full(self.shape, np.rint(self.ambient * self.full_scale), dtype)
        return ImageStack(values.astype(dtype), ambient)

    def coordinates(self) -> tuple[Array, Array]:
        rows, columns = self.shape
        unit = 0.5 * max(rows, columns)
        x = (np.arange(columns) - 0.5 * (columns - 1)) / unit
        y = (0.5 * (rows - 1) - np.arange(rows)) / unit
        return np.meshgrid(x, y)

    def _strengths(self, tilt: tuple[float, float]) -> Array:
        x, y = self.coordinates()
        p, q = tilt
        normal = np.array([-p, -q, 1.0]) / np.sqrt(1.0 + p * p + q * q)
        corner = x.max() ** 2 + y.max() ** 2
        lens = 1.0 - self.vignetting * (x * x + y * y) / corner
        images = []
        for position, level in zip(np.asarray(self.positions), self.levels, strict=True):
            towards = position[:, None, None] - np.stack([x, y, p * x + q * y])
            distance = np.sqrt((towards**2).sum(axis=0))
            cosine = np.tensordot(normal, towards, 1) / distance
            axis = position / np.linalg.norm(position) if self.aim == "centre" else (0.0, 0.0, 1.0)
            lobe = np.clip(np.tensordot(axis, towards, 1) / distance, 0.0, 1.0) ** self.lobe
            images.append(level * cosine * lobe / distance**2)
        return np.array(images) * lens

    def _gloss(self) -> Array:
        x, y = self.coordinates()
        glosses = []
        for position in np.asarray(self.positions):
            towards = position[:, None, None] - np.stack([x, y, 0.0 * x])
            towards /= np.sqrt((towards**2).sum(axis=0))
            view = np.stack([-x, -y, 10.0 + 0.0 * x])
            view /= np.sqrt((view**2).sum(axis=0))
            half = towards + view
            half /= np.sqrt((half**2).sum(axis=0))
            glosses.append(self.gloss * half[2] ** self.shine)
        return np.array(glosses)

    def _sheet(self) -> Array:
        """(H, W) reflectance; the sheet is a square that covers the frame in any orientation."""
        rng = np.random.default_rng(self.seed)
        side = max(self.shape)
        sheet = 1.0 + self.grain * rng.standard_normal((side, side))
        u, v = np.meshgrid(*2 * (np.linspace(-1.0, 1.0, side),))
        sheet *= 1.0 + self.waviness * (u + 0.5 * np.sin(3.0 * v + 1.0))
        for _ in range(self.specks):
            row, column = rng.integers(0, side, 2)
            radius = rng.integers(1, 5)
            sheet[
                max(row - radius, 0) : row + radius, max(column - radius, 0) : column + radius
            ] *= rng.uniform(0.2, 0.9)
        turned = np.rot90(sheet, self.quarter_turns)
        rows, columns = ((side - length) // 2 for length in self.shape)
        return turned[rows : rows + self.shape[0], columns : columns + self.shape[1]]


def ring_positions(
    radius: float, slants_deg: float | Array = 45.0, tilts_deg: Array = (0.0, 90.0, 180.0, 270.0)
) -> Array:
    """Positions at one distance from the middle of the frame."""
    return radius * light_vectors(tilts_deg, slants_deg)
