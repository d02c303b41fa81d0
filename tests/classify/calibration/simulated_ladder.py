"""Block means of a white sheet under one light at several exposures."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Curve = Callable[[FloatArray], FloatArray]

WELL_E, READ_E, PIXELS, FULL = 10_000.0, 5.0, 4096, 255.0
# Octaves below, even steps above: fewer and coarser than those of `ladder_ms`.
EXPOSURES_MS = np.unique(np.round(np.r_[20.0 * 0.5 ** np.arange(7), np.linspace(2.0, 20.0, 10)], 1))


def srgb(light: FloatArray) -> FloatArray:
    """Pixel value of linear light (IEC 61966-2-1)."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def gamma(exponent: float) -> Curve:
    """The camera whose light is its pixel value to the power of `exponent`."""
    return lambda light: light ** (1.0 / exponent)


def ladder(
    curve: Curve,
    fall_off: float = 0.4,
    black: float = 1 / 64,
    exposures_ms: FloatArray = EXPOSURES_MS,
    seed: int = 0,
) -> FloatArray:
    """(E, n) block means at the given exposures; NaN where saturated."""
    rng = np.random.default_rng(seed)
    strength = 1.0 - fall_off * np.linspace(0.0, 1.0, 64)
    light = black + (1.0 - black) * strength * exposures_ms[:, None] / 20.0
    noise = np.sqrt(light * WELL_E + READ_E**2) / WELL_E / np.sqrt(PIXELS)
    values = curve(np.clip(light + noise * rng.standard_normal(light.shape), 0.0, 1.0))
    return np.where(light < 0.985, FULL * values, np.nan)
