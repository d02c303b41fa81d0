"""Power spectra of height or albedo, as functions of frequency in cycles per pixel.

Each function returns a spectrum: a function of u (along x) and v (along y) that gives the power
up to a factor. The spectra are even in u and in v, so the direction of y does not matter; only
`rotated` depends on it, and takes y up.
"""

import math
from collections.abc import Callable

import numpy as np

from classify.base.arrays import Floats

PowerSpectrum = Callable[[Floats, Floats], Floats]


def fractal(exponent: float) -> PowerSpectrum:
    """Isotropic fractal: w^-(2 H + 2) for the Hurst exponent H, infinite at 0."""
    return lambda u, v: np.asarray(np.hypot(u, v) ** -exponent)


def mulvaney(cutoff_cpp: float) -> PowerSpectrum:
    """Isotropic, after Mulvaney (1989): (w^2 / cutoff^2 + 1)^(-3/2)."""
    return lambda u, v: np.asarray(((u**2 + v**2) / cutoff_cpp**2 + 1.0) ** -1.5)


def ogilvy(cutoff_x_cpp: float, cutoff_y_cpp: float) -> PowerSpectrum:
    """After Ogilvy (1991): 1 / ((u^2 + u_c^2) (v^2 + v_c^2)); grain along the lower cut-off."""
    return lambda u, v: 1.0 / ((u**2 + cutoff_x_cpp**2) * (v**2 + cutoff_y_cpp**2))


def ripples(frequency_cpp: float, width_along: float, width_across: float) -> PowerSpectrum:
    """Gaussian lobes at +-frequency along x, with widths along and across in cycles/px."""

    def spectrum(u: Floats, v: Floats) -> Floats:
        across = np.exp(-0.5 * (v / width_across) ** 2)
        right = np.exp(-0.5 * ((u - frequency_cpp) / width_along) ** 2)
        left = np.exp(-0.5 * ((u + frequency_cpp) / width_along) ** 2)
        return np.asarray(across * (right + left))

    return spectrum


def ring(frequency_cpp: float, width_cpp: float) -> PowerSpectrum:
    """Isotropic with one scale: a Gaussian about one radius."""
    return lambda u, v: np.asarray(
        np.exp(-0.5 * ((np.hypot(u, v) - frequency_cpp) / width_cpp) ** 2)
    )


def rotated(spectrum: PowerSpectrum, rotate_deg: float) -> PowerSpectrum:
    """Spectrum of the surface rotated anticlockwise, on a grid whose rows run down."""
    cos, sin = math.cos(math.radians(rotate_deg)), math.sin(math.radians(rotate_deg))
    return lambda u, v: spectrum(cos * u - sin * v, -sin * u - cos * v)


def summed(*spectra: PowerSpectrum) -> PowerSpectrum:
    """Spectrum of the sum of independent surfaces."""
    return lambda u, v: np.sum([spectrum(u, v) for spectrum in spectra], axis=0)
