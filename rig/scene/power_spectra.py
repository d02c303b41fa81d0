"""Power spectra of height or albedo, as functions of frequency in cycles per pixel.

Each function here makes a spectrum: a function of u (along x) and v (along y) that gives the
power there, to a factor. What is even in u and v is the same whether y points up or down;
`turned` takes y up.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

__all__ = [
    "PowerSpectrum",
    "fractal",
    "mulvaney",
    "ogilvy",
    "ring",
    "ripples",
    "together",
    "turned",
]

Frequencies = npt.NDArray[np.float64]
PowerSpectrum = Callable[[Frequencies, Frequencies], Frequencies]


def fractal(exponent: float) -> PowerSpectrum:
    """Isotropic, w^-exponent; a fractal of Hurst exponent H has 2 H + 2. Infinite at w = 0."""
    return lambda u, v: np.asarray(np.hypot(u, v) ** -exponent)


def mulvaney(cutoff_cpp: float) -> PowerSpectrum:
    """After Mulvaney (1989): flat up to a cut-off in cycles/px, then as w^-3."""
    return lambda u, v: np.asarray(((u**2 + v**2) / cutoff_cpp**2 + 1.0) ** -1.5)


def ogilvy(cutoff_x_cpp: float, cutoff_y_cpp: float) -> PowerSpectrum:
    """After Ogilvy: a cut-off along x and one along y; the grain lies along the lower one."""
    return lambda u, v: 1.0 / ((u**2 + cutoff_x_cpp**2) * (v**2 + cutoff_y_cpp**2))


def ripples(frequency_cpp: float, width_along: float, width_across: float) -> PowerSpectrum:
    """Ripples with their wave vector along x: Gaussian lobes at +-frequency.

    Their widths, in cycles/px, are given along the wave vector (how even the spacing is) and
    across it (how straight the crests are).
    """

    def spectrum(u: Frequencies, v: Frequencies) -> Frequencies:
        across = np.exp(-0.5 * (v / width_across) ** 2)
        right = np.exp(-0.5 * ((u - frequency_cpp) / width_along) ** 2)
        left = np.exp(-0.5 * ((u + frequency_cpp) / width_along) ** 2)
        return np.asarray(across * (right + left))

    return spectrum


def ring(frequency_cpp: float, width_cpp: float) -> PowerSpectrum:
    """Isotropic, all of one scale: a Gaussian about one radius."""
    return lambda u, v: np.asarray(
        np.exp(-0.5 * ((np.hypot(u, v) - frequency_cpp) / width_cpp) ** 2)
    )


def turned(spectrum: PowerSpectrum, turn_deg: float) -> PowerSpectrum:
    """The spectrum of a surface that is turned anticlockwise, where rows run down."""
    cos, sin = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    return lambda u, v: spectrum(cos * u - sin * v, -sin * u - cos * v)


def together(*spectra: PowerSpectrum) -> PowerSpectrum:
    """The spectrum of the sum of independent surfaces."""
    return lambda u, v: np.sum([spectrum(u, v) for spectrum in spectra], axis=0)
