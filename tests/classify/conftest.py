"""Directional random textures with analytic gradients, at any orientation."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from classify import SurfaceEstimate

Texture = Callable[..., SurfaceEstimate]


@dataclass(frozen=True)
class Kind:
    """A texture as the distribution of its plane waves."""

    frequency_cpp: float
    octaves: float  # standard deviation of the frequency
    direction_deg: float
    spread_deg: float  # standard deviation of the direction


KINDS = {
    "ripple": Kind(0.08, 0.15, 0.0, 6.0),
    "fine": Kind(0.20, 0.15, 0.0, 6.0),
    "grain": Kind(0.10, 0.6, 30.0, 18.0),
    "even": Kind(0.10, 0.5, 0.0, 400.0),
}


def estimate(p: np.ndarray, q: np.ndarray, albedo: np.ndarray) -> SurfaceEstimate:
    shape = p.shape
    return SurfaceEstimate(
        p=p.astype(np.float32),
        q=q.astype(np.float32),
        albedo=albedo.astype(np.float32),
        residual=np.zeros(shape, np.float32),
        dropped=np.full(shape, 255, np.uint8),
        shadow_count=np.zeros(shape, np.uint8),
        saturated=np.zeros(shape, bool),
        valid=np.ones(shape, bool),
        method="least_squares",
    )


def _texture(
    kind: str, turn_deg: float = 0.0, seed: int = 0, side: int = 128, rows: int | None = None
) -> SurfaceEstimate:
    """A surface turned anticlockwise by `turn_deg` about the middle of the frame."""
    rng = np.random.default_rng(seed)
    shape = KINDS[kind]
    waves = 300
    frequency = shape.frequency_cpp * 2.0 ** (shape.octaves * rng.standard_normal(waves))
    frequency = np.minimum(frequency, 0.4)
    angle = shape.direction_deg + turn_deg + shape.spread_deg * rng.standard_normal(waves)
    u = frequency * np.cos(np.radians(angle))
    v = frequency * np.sin(np.radians(angle))
    rows = side if rows is None else rows
    x = np.arange(side) - (side - 1) / 2.0
    y = (rows - 1) / 2.0 - np.arange(rows)
    along_x = np.exp(2j * np.pi * u[:, None] * x)
    along_y = np.exp(2j * np.pi * y[:, None] * v)

    def field(weights: np.ndarray) -> np.ndarray:
        return ((along_y * weights) @ along_x).real

    height = np.exp(2j * np.pi * rng.random(waves)) / frequency / np.sqrt(waves)
    paint = np.exp(2j * np.pi * rng.random(waves)) / np.sqrt(waves)
    p = 0.4 * field(1j * height * u)
    q = 0.4 * field(1j * height * v)
    return estimate(p, q, 0.6 + 0.05 * field(paint))


@pytest.fixture(scope="session")
def texture() -> Texture:
    """Make a surface: kind, turn_deg, seed, side, rows."""
    return _texture


@pytest.fixture(scope="session")
def surface_of() -> Texture:
    """Make a surface of given p, q and albedo, all valid."""
    return estimate
