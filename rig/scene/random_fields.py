"""Stationary random fields on a periodic tile, for relief and albedo.

A field draws one realisation from a generator: (side, side) float64, up to a factor. All lengths
are in pixels, so the statistics do not depend on the side of the tile. All fields are limited to
the frequencies of `round_band_limit`, so that they can be rotated.
"""

from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt
from scipy import fft

from classify.base.arrays import Floats
from classify.base.threads import thread_count

from .power_spectra import PowerSpectrum
from .surfaces import round_band_limit

Field = Callable[[np.random.Generator, int], Floats]


def gaussian(power: PowerSpectrum) -> Field:
    """Gaussian field with the power spectrum `power`: filtered white noise."""
    return lambda rng, side: _filtered(rng.standard_normal((side, side)), power)


def shot_noise(power: PowerSpectrum, spacing_px: float) -> Field:
    """One bump at each of one random point per spacing^2: skewed, with the spectrum `power`."""

    def field(rng: np.random.Generator, side: int) -> Floats:
        impulses = rng.poisson(spacing_px**-2.0, (side, side)).astype(np.float64)
        # A tile without a bump has no slope that could be scaled.
        impulses[0, 0] += not impulses.any()
        return _filtered(impulses, power)

    return field


def cells(spacing_px: float) -> Field:
    """Worley (1996): -r^2, r the distance to the nearest of one random point per spacing^2."""
    # P(r > 3 spacing) = exp(-9 pi) = 5e-13 for a Poisson process.
    reach_px = round(3.0 * spacing_px)

    def field(rng: np.random.Generator, side: int) -> Floats:
        elsewhere = (rng.random((side, side)) >= spacing_px**-2.0).astype(np.uint8)
        elsewhere[0, 0] &= not elsewhere.all()
        periodic = np.pad(elsewhere, reach_px, mode="wrap")
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


def _filtered(values: Floats, power: PowerSpectrum | None = None) -> Floats:
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
