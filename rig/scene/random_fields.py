"""Stationary random fields on a periodic tile, for relief and albedo, and their power spectra.

A field draws one realisation from a generator: (side, side) float64, up to a factor. All lengths
are in pixels, so the statistics do not depend on the side of the tile. All fields are limited to
the frequencies of `round_band_limit`, so that they can be rotated.

A spectrum gives the power up to a factor for the frequencies u (along x) and v (along y) in cycles
per pixel. It is even in u and in v; only `rotated` depends on the direction of y, and takes y up.
"""

import math
from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt
from scipy import fft

from classify.base.arrays import Floats
from classify.base.threads import thread_count

from .surfaces import round_band_limit

_PowerSpectrum = Callable[[Floats, Floats], Floats]


def fractal(exponent: float) -> _PowerSpectrum:
    """Isotropic fractal: w^-(2 H + 2) for the Hurst exponent H, infinite at 0."""
    return lambda u, v: np.asarray(np.hypot(u, v) ** -exponent)


def mulvaney(cutoff_cpp: float) -> _PowerSpectrum:
    """Isotropic, after Mulvaney (1989): (w^2 / cutoff^2 + 1)^(-3/2)."""
    return lambda u, v: np.asarray(((u**2 + v**2) / cutoff_cpp**2 + 1.0) ** -1.5)


def ogilvy(cutoff_x_cpp: float, cutoff_y_cpp: float) -> _PowerSpectrum:
    """After Ogilvy (1991): 1 / ((u^2 + u_c^2) (v^2 + v_c^2)); grain along the lower cut-off."""
    return lambda u, v: 1.0 / ((u**2 + cutoff_x_cpp**2) * (v**2 + cutoff_y_cpp**2))


def ripples(frequency_cpp: float, width_along: float, width_across: float) -> _PowerSpectrum:
    """Gaussian lobes at +-frequency along x, with widths along and across in cycles/px."""

    def spectrum(u: Floats, v: Floats) -> Floats:
        across = np.exp(-0.5 * (v / width_across) ** 2)
        right = np.exp(-0.5 * ((u - frequency_cpp) / width_along) ** 2)
        left = np.exp(-0.5 * ((u + frequency_cpp) / width_along) ** 2)
        return np.asarray(across * (right + left))

    return spectrum


def ring(frequency_cpp: float, width_cpp: float) -> _PowerSpectrum:
    """Isotropic with one scale: a Gaussian about one radius."""
    return lambda u, v: np.asarray(
        np.exp(-0.5 * ((np.hypot(u, v) - frequency_cpp) / width_cpp) ** 2)
    )


def rotated(spectrum: _PowerSpectrum, rotate_deg: float) -> _PowerSpectrum:
    """Spectrum of the surface rotated anticlockwise, on a grid whose rows run down."""
    cos, sin = math.cos(math.radians(rotate_deg)), math.sin(math.radians(rotate_deg))
    return lambda u, v: spectrum(cos * u - sin * v, -sin * u - cos * v)


def summed(*spectra: _PowerSpectrum) -> _PowerSpectrum:
    """Spectrum of the sum of independent surfaces."""
    return lambda u, v: np.sum([spectrum(u, v) for spectrum in spectra], axis=0)


Field = Callable[[np.random.Generator, int], Floats]


def gaussian(power: _PowerSpectrum) -> Field:
    """Gaussian field with the power spectrum `power`: filtered white noise."""
    return lambda rng, side: _filtered(rng.standard_normal((side, side)), power)


def shot_noise(power: _PowerSpectrum, spacing_px: float) -> Field:
    """One bump at each of one random point per spacing^2: skewed, with the spectrum `power`."""

    def field(rng: np.random.Generator, side: int) -> Floats:
        impulses = rng.poisson(spacing_px**-2.0, (side, side)).astype(np.float64)
        if not impulses.any():
            impulses[0, 0] = 1.0  # a tile without a bump has no slope that could be scaled
        return _filtered(impulses, power)

    return field


def cells(spacing_px: float) -> Field:
    """Worley (1996): -r^2, r the distance to the nearest of one random point per spacing^2."""
    # P(r > 3 spacing) = exp(-9 pi) = 5e-13 for a Poisson process.
    reach_px = round(3.0 * spacing_px)

    def field(rng: np.random.Generator, side: int) -> Floats:
        no_point = (rng.random((side, side)) >= spacing_px**-2.0).astype(np.uint8)
        if no_point.all():
            no_point[0, 0] = 0
        periodic = np.pad(no_point, reach_px, mode="wrap")
        distance = cv2.distanceTransform(periodic, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        inside = slice(reach_px, reach_px + side)
        # Squared distances are whole numbers. OpenCV rounds their roots in two ways, depending on
        # its number of threads and on the address of the array.
        return _filtered(-np.rint(distance[inside, inside].astype(np.float64) ** 2))

    return field


def ridged(field: Field) -> Field:
    """Sharp ridges along the zeros of a field g: -|g|."""
    return lambda rng, side: _filtered(-np.abs(field(rng, side)))


def crested(field: Field) -> Field:
    """High narrow crests and wide flat troughs: exp(0.7 g / std(g)), of skewness 2.9."""

    def crests(rng: np.random.Generator, side: int) -> Floats:
        values = field(rng, side)
        return _filtered(np.exp(0.7 * values / values.std()))

    return crests


def inverted(field: Field) -> Field:
    """Negative of a field: pits for bumps, with the same power spectrum."""
    return lambda rng, side: -field(rng, side)


def phase_randomised(field: Field) -> Field:
    """Gaussian field with the amplitudes of a realisation of `field` and random phases."""

    def twin(rng: np.random.Generator, side: int) -> Floats:
        amplitude = np.abs(fft.rfft2(field(rng, side), workers=thread_count()))
        phases = fft.rfft2(rng.standard_normal((side, side)), workers=thread_count())
        phases *= amplitude / np.maximum(np.abs(phases), 1e-300)
        return _inverse(phases, side)

    return twin


def shaded(values: Floats, contrast: float) -> Floats:
    """Shades of mean 0: tanh(contrast g / std(g)), band-limited, which overshoots +-1 a little."""
    return _filtered(np.tanh((contrast / values.std()) * values))


def _filtered(values: Floats, power: _PowerSpectrum | None = None) -> Floats:
    """Subtract the mean, low-pass, and multiply by sqrt(power) if given."""
    side = len(values)
    gain = round_band_limit(side, side).astype(np.float64)
    if power is not None:
        # A fractal has infinite power at zero frequency; that term is set to 0 below.
        with np.errstate(divide="ignore"):
            gain *= np.sqrt(power(fft.rfftfreq(side)[None, :], fft.fftfreq(side)[:, None]))
    gain[0, 0] = 0.0
    return _inverse(fft.rfft2(values, workers=thread_count()) * gain, side)


def _inverse(spectrum: npt.NDArray[np.complex128], side: int) -> Floats:
    return np.asarray(fft.irfft2(spectrum, s=(side, side), workers=thread_count()))
