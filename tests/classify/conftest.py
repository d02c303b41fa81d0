"""Random textures at any orientation: plane waves or a stationary field."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from classify import Lighting, SurfaceEstimate

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
    return SurfaceEstimate(
        p=p.astype(np.float32),
        q=q.astype(np.float32),
        albedo=albedo.astype(np.float32),
        valid=np.ones(p.shape, bool),
        method="least_squares",
    )


def _texture(
    kind: str, orientation_deg: float = 0.0, seed: int = 0, side: int = 128, rows: int | None = None
) -> SurfaceEstimate:
    """A surface rotated anticlockwise about the middle of the frame."""
    rng = np.random.default_rng(seed)
    shape = KINDS[kind]
    waves = 300
    frequency = shape.frequency_cpp * 2.0 ** (shape.octaves * rng.standard_normal(waves))
    frequency = np.minimum(frequency, 0.4)
    angle = shape.direction_deg + orientation_deg + shape.spread_deg * rng.standard_normal(waves)
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
    """Make a surface: kind, orientation_deg, seed, side, rows."""
    return _texture


@pytest.fixture(scope="session")
def surface_of() -> Texture:
    """Make a surface of given p, q and albedo, all valid."""
    return estimate


Amplitude = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _lobes(frequency_cpp: float, width_cpp: float) -> Amplitude:
    """Ripples with wave vectors along the x axis."""
    return lambda u, v: np.exp(
        -0.25 * (((np.abs(u) - frequency_cpp) / width_cpp) ** 2 + (v / width_cpp) ** 2)
    )


def _ogilvy(along_cpp: float, across_cpp: float) -> Amplitude:
    return lambda u, v: 1.0 / np.sqrt((u**2 + along_cpp**2) * (v**2 + across_cpp**2))


def _mulvaney(corner_cpp: float) -> Amplitude:
    return lambda u, v: ((u**2 + v**2) / corner_cpp**2 + 1.0) ** -0.75


def _bump(width_cpp: float) -> Amplitude:
    return lambda u, v: np.exp(-0.5 * (u**2 + v**2) / width_cpp**2)


@dataclass(frozen=True)
class Field:
    """A stationary texture: amplitude of its relief and of its paint, and its source."""

    relief: Amplitude
    paint: Amplitude | None = None
    impulses: float = 0.0  # per square pixel, of this sign; 0 for white noise


FIELDS = {
    "sand": Field(_lobes(0.08, 0.012)),
    "fine sand": Field(_lobes(0.15, 0.02)),
    "brushed": Field(_ogilvy(0.12, 0.02)),
    "malv": Field(_mulvaney(0.05)),
    "rough": Field(_mulvaney(0.2)),
    "dyed": Field(_mulvaney(0.05), paint=_lobes(0.10, 0.02)),
    "domes": Field(_bump(0.05), impulses=0.004),
    "pits": Field(_bump(0.05), impulses=-0.004),
}


def _stationary(
    kind: str, orientation_deg: float = 0.0, seed: int = 0, side: int = 128, rows: int | None = None
) -> SurfaceEstimate:
    """One realisation per seed at an orientation, with the errors of a camera."""
    field = FIELDS[kind]
    rows = side if rows is None else rows
    rng = np.random.default_rng([seed, list(FIELDS).index(kind)])
    u, v = np.fft.rfftfreq(side)[None, :], -np.fft.fftfreq(rows)[:, None]
    c, s = np.cos(np.radians(orientation_deg)), np.sin(np.radians(orientation_deg))
    along, across = c * u + s * v, c * v - s * u
    inside = (np.hypot(u, v) < 0.45) & (np.hypot(u, v) > 0.0)

    def inverse(transform: np.ndarray) -> np.ndarray:
        return np.fft.irfft2(transform, s=(rows, side))

    if field.impulses:
        source = np.sign(field.impulses) * rng.poisson(abs(field.impulses), (rows, side))
    else:
        source = rng.standard_normal((rows, side))
    height = np.fft.rfft2(source) * field.relief(along, across) * inside
    p, q = inverse(2j * np.pi * u * height), inverse(2j * np.pi * v * height)
    scale = 0.4 / np.sqrt(np.mean(p**2 + q**2))
    albedo = np.full((rows, side), 0.6)
    if field.paint is not None:
        paint = np.fft.rfft2(rng.standard_normal((rows, side)))
        pattern = inverse(paint * field.paint(along, across) * inside)
        albedo += 0.1 * pattern / pattern.std()
    p_error, q_error, albedo_error = rng.standard_normal((3, rows, side))
    return estimate(
        scale * p + 0.02 * p_error, scale * q + 0.02 * q_error, albedo + 0.005 * albedo_error
    )


@pytest.fixture(scope="session")
def stationary() -> Texture:
    """Make a surface of one of FIELDS: kind, orientation_deg, seed, side, rows."""
    return _stationary


def _photographed(surface: SurfaceEstimate, slant_deg: float = 45.0) -> SurfaceEstimate:
    """The surface with its 16-bit images, without cast shadows, and their lights."""
    lighting = Lighting.ring(slant_deg)
    shading = np.einsum("nk,hwk->nhw", lighting.directions, surface.normals)
    images = np.clip(surface.albedo * np.maximum(shading, 0.0) * 50_000, 0, 65_535)
    return replace(surface, images=np.round(images).astype(np.uint16), lighting=lighting)


@pytest.fixture(scope="session")
def photographed() -> Texture:
    """Add images to a surface: surface, slant_deg."""
    return _photographed
