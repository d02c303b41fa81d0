"""Matched filters of spots and scratches: their responses in every cell.

The matched filter of a defect divides the field by the power spectrum of the texture and by
nothing else that depends on the texture (North 1943). A spot or a scratch of half width s is a
Gaussian, across or all around, so both have one radial filter: exp(-2 (pi s k)^2) in the albedo and
k times that in the slopes. A scratch is then a sum along a line.
"""

from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import scipy.fft

from classify.surface.estimate import FloatMap

from .fields import HALF_CELL, cell_maximum
from .lines import DIRECTIONS, LENGTHS, line_response
from .whitening import HalfSpectrum, frequencies, low_pass


class _Filter(NamedTuple):
    """Its departure, half width in pixels of the frame, octave below half resolution, and shape."""

    departure: int
    width_px: float
    octave: int
    is_line: bool


_SPOTS, FINE, WIDE, ALBEDO = range(4)
"""Departures: spots, fine and wide scratches of the relief; spots and scratches of the albedo."""
# The filter of 1 px found more ploughed grooves of 1.5 px on the even textures than one of 1.5 px.
FILTERS = (
    *(_Filter(kind, width_px, 1, False) for kind in (_SPOTS, ALBEDO) for width_px in (4, 8, 16)),
    _Filter(FINE, 1.0, 0, True),
    *(
        _Filter(kind, width_px, 1, True)
        for kind, width_px in ((WIDE, 2.5), (WIDE, 4), (ALBEDO, 2.5))
    ),
)
SIZES = tuple(DIRECTIONS * LENGTHS if matched.is_line else 1 for matched in FILTERS)
"""Number of responses of each filter."""

Response = Callable[[FloatMap], FloatMap]
"""(h, w) float32 largest absolute response in every cell, of responses with given weights."""


def filter_responses(
    spectra: tuple[HalfSpectrum, HalfSpectrum], orientation_deg: float
) -> Iterator[Response]:
    """The `Response` of each filter to relief and albedo, divided by the power of their texture."""
    for matched in FILTERS:
        spectrum = spectra[int(matched.departure == ALBEDO)]
        shape = (spectrum.shape[0], 2 * (spectrum.shape[1] - 1))
        field = _filtered(spectrum, _profile(shape, matched), matched.octave)
        cell = HALF_CELL >> matched.octave
        if matched.is_line:
            yield partial(line_response, field, cell, orientation_deg)
        else:
            yield partial(np.multiply, cell_maximum(np.abs(field), cell))


def _filtered(spectrum: HalfSpectrum, profile: HalfSpectrum, octave: int) -> FloatMap:
    """A filtered field, sampled every 2 ** octave pixels."""
    rows, half = profile.shape
    if octave:
        spectrum = np.concatenate([spectrum[: rows // 2, :half], spectrum[-(rows // 2) :, :half]])
    return np.asarray(scipy.fft.irfft2(spectrum * profile, s=(rows, 2 * (half - 1))), np.float32)


@lru_cache(maxsize=32)
def _profile(shape: tuple[int, int], matched: _Filter) -> HalfSpectrum:
    """The radial filter on the half spectrum of the sampled field."""
    step = 1 << matched.octave
    sampled = (shape[0] // step, shape[1] // step)
    u, v = frequencies(sampled)
    k = np.hypot(u, v)
    profile = np.exp(-2.0 * (np.pi * matched.width_px / (2 * step) * k) ** 2)
    if matched.octave:
        profile *= low_pass(k)
    if matched.departure != ALBEDO:
        profile = profile * k
    # Samples in the middle of the pixels that they stand for; rows run down, and v up.
    shift = 0.5 * (step - 1) / step
    return np.asarray(profile * np.exp(2j * np.pi * shift * (u - v)), np.complex64)
