"""Matched filters of spots and scratches: their responses in every cell.

The matched filter of a defect divides the field by the power spectrum of the texture and by
nothing else that depends on the texture (North 1943). A spot or a scratch of half width s is a
Gaussian, across or all around, so both have one radial filter: exp(-2 (pi s k)^2) in the albedo and
k times that in the slopes. A scratch is then a sum along a line.
"""

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy.fft

from classify.surface.estimate import FloatMap

from .fields import HALF_CELL, cell_maximum
from .lines import DIRECTIONS, LENGTHS, line_responses
from .whitening import HalfSpectrum, frequencies, low_pass


class _Filter(NamedTuple):
    """Half width in pixels of the frame, octave below half resolution, and its shape."""

    width_px: float
    octave: int
    is_line: bool


_SPOTS = tuple(_Filter(width_px, octave, False) for width_px, octave in ((4, 1), (8, 1), (16, 1)))
# The filter of 1 px found more ploughed grooves of 1.5 px on the even textures than one of 1.5 px.
_FINE, _WIDE, _WIDEST = _Filter(1.0, 0, True), _Filter(2.5, 1, True), _Filter(4.0, 1, True)
RELIEF_BANKS = (_SPOTS, (_FINE,), (_WIDE, _WIDEST))
BANKS = (*RELIEF_BANKS, (*_SPOTS, _WIDE))
"""Filters for spots, fine and wide scratches of the relief, then for the albedo."""
SIZES = tuple(sum(LENGTHS * DIRECTIONS if f.is_line else 1 for f in bank) for bank in BANKS)
"""Number of responses of each bank."""


def filter_responses(
    spectra: tuple[HalfSpectrum, HalfSpectrum], orientation_deg: float
) -> Iterator[FloatMap]:
    """(n, h, w) float32 highest absolute responses in every cell, for each bank.

    Parameters
    ----------
    spectra
        Half spectra of relief and albedo at half resolution, divided by the power of the texture.
    orientation_deg
        Orientation of the texture.
    """
    for number, bank in enumerate(BANKS):
        is_relief = number < len(RELIEF_BANKS)
        spectrum = spectra[0 if is_relief else 1]
        shape = (spectrum.shape[0], 2 * (spectrum.shape[1] - 1))
        responses = []
        for each in bank:
            field = _filtered(spectrum, _profile(shape, each, is_relief), each.octave)
            cell = HALF_CELL >> each.octave
            if each.is_line:
                responses.append(line_responses(field, cell, orientation_deg))
            else:
                responses.append(cell_maximum(np.abs(field), cell)[None])
        yield np.concatenate(responses)


def _filtered(spectrum: HalfSpectrum, profile: HalfSpectrum, octave: int) -> FloatMap:
    """A filtered field, sampled every 2 ** octave pixels."""
    rows, half = profile.shape
    if octave:
        spectrum = np.concatenate([spectrum[: rows // 2, :half], spectrum[-(rows // 2) :, :half]])
    return np.asarray(scipy.fft.irfft2(spectrum * profile, s=(rows, 2 * (half - 1))), np.float32)


@lru_cache(maxsize=32)
def _profile(shape: tuple[int, int], each: _Filter, is_relief: bool) -> HalfSpectrum:
    """The radial filter on the half spectrum of the sampled field."""
    step = 1 << each.octave
    sampled = (shape[0] // step, shape[1] // step)
    u, v = frequencies(sampled)
    k = np.hypot(u, v)
    profile = np.exp(-2.0 * (np.pi * each.width_px / (2 * step) * k) ** 2)
    if each.octave:
        profile *= low_pass(k)
    if is_relief:
        profile = profile * k
    # Samples in the middle of the pixels that they stand for; rows run down, and v up.
    shift = 0.5 * (step - 1) / step
    return np.asarray(profile * np.exp(2j * np.pi * shift * (u - v)), np.complex64)
