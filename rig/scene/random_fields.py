"""Stationary random fields on a periodic tile: what relief and albedo are made of.

A field draws one realisation from a generator: (side, side) float64, to a factor. Everything is
in pixels, so its statistics do not depend on the side of the tile, and everything is limited to
the frequencies of `round_band_limit`, so that it may be turned.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt
from scipy import fft

from .power_spectra import PowerSpectrum
from .surfaces import round_band_limit

__all__ = [
    "Field",
    "cells",
    "crested",
    "gaussian",
    "inverted",
    "phase_randomised",
    "ridged",
    "shaded",
    "shot_noise",
]

Image = npt.NDArray[np.float64]
Field = Callable[[np.random.Generator, int], Image]


def gaussian(power: PowerSpectrum) -> Field:
    """A Gaussian field: random phases and Rayleigh amplitudes, and nothing but its spectrum."""
    # White Gaussian noise has just these, with the right symmetry.
    return lambda rng, side: _filtered(rng.standard_normal((side, side)), power)


def shot_noise(power: PowerSpectrum, spacing_px: float) -> Field:
    """The same bump at places of a Poisson process, one per spacing^2: skewed, or flecks.

    The bump is the real, even function whose squared transform is `power`. Impulses in place of
    white noise leave the power spectrum as it is.
    """

    def field(rng: np.random.Generator, side: int) -> Image:
        impulses = rng.poisson(spacing_px**-2.0, (side, side)).astype(np.float64)
        # A tile without a single bump has no slope to be scaled.
        impulses[0, 0] += not impulses.any()
        return _filtered(impulses, power)

    return field


def cells(spacing_px: float) -> Field:
    """Round-topped cells with creases between them, as cobbles: -r^2 to the nearest of points.

    After Worley (1996). The points are a Poisson process, one per spacing^2 on average.
    """
    # With a Poisson process no point is this far from its nearest one (1e-12).
    reach_px = round(3.0 * spacing_px)

    def field(rng: np.random.Generator, side: int) -> Image:
        elsewhere = (rng.random((side, side)) >= spacing_px**-2.0).astype(np.uint8)
        elsewhere[0, 0] &= not elsewhere.all()
        periodic = np.pad(elsewhere, reach_px, mode="wrap")
        distance = cv2.distanceTransform(periodic, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        inside = slice(reach_px, reach_px + side)
        return _filtered(-(distance[inside, inside].astype(np.float64) ** 2))

    return field


def ridged(field: Field) -> Field:
    """-|g|: sharp ridges along the zeros of a field."""
    return lambda rng, side: _filtered(-np.abs(field(rng, side)))


def crested(field: Field) -> Field:
    """exp(0.7 g / std(g)): high narrow crests, wide flat troughs."""

    def crests(rng: np.random.Generator, side: int) -> Image:
        values = field(rng, side)
        return _filtered(np.exp(0.7 * values / values.std()))

    return crests


def inverted(field: Field) -> Field:
    """Pits for bumps. The power spectrum stays."""
    return lambda rng, side: -field(rng, side)


def phase_randomised(field: Field) -> Field:
    """A Gaussian field with the power spectrum of another: its own amplitudes, random phases."""

    def twin(rng: np.random.Generator, side: int) -> Image:
        amplitude = np.abs(fft.rfft2(field(rng, side), workers=-1))
        phases = fft.rfft2(rng.standard_normal((side, side)), workers=-1)
        phases *= amplitude / np.maximum(np.abs(phases), 1e-300)
        return _inverse(phases, side)

    return twin


def shaded(values: Image, contrast: float) -> Image:
    """tanh(contrast g / std(g)): soft shades for a small contrast, two tones for a large one.

    Within about -1 to 1, as the band limit rounds off the edges between two tones and swings
    over a little; of mean 0.
    """
    return _filtered(np.tanh((contrast / values.std()) * values))


def _filtered(values: Image, power: PowerSpectrum | None = None) -> Image:
    """Less its mean and what lies beyond the band limit, times the root of `power` if given."""
    side = len(values)
    gain = round_band_limit(side, side).astype(np.float64)
    if power is not None:
        # A fractal has infinite power at zero frequency, which is set to nothing below.
        with np.errstate(divide="ignore"):
            gain *= np.sqrt(power(fft.rfftfreq(side)[None, :], fft.fftfreq(side)[:, None]))
    gain[0, 0] = 0.0
    return _inverse(fft.rfft2(values, workers=-1) * gain, side)


def _inverse(spectrum: npt.NDArray[np.complex128], side: int) -> Image:
    return np.asarray(fft.irfft2(spectrum, s=(side, side), workers=-1))
