"""Polar maps as Fourier series in the angle: turning is a phase, comparing over all turns a sum.

A map over half a turn is f(theta) = sum_m c_m exp(2 i m theta). Turned by phi, c_m takes the
phase exp(-2 i m phi), so the squared difference of two maps for every phi at once is one
short inverse transform of sum c_m conj(d_m): nothing is interpolated, and no angle has to be
guessed beforehand. The moduli do not turn at all, and give a bound from below for every turn.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.fft

from classify.compiling import kernel
from classify.surface.estimate import FloatMap
from classify.threads import run_on_rows

__all__ = ["HARMONICS", "LeastError", "harmonics", "least_error", "shift_invariant_norms"]

HARMONICS = 16
"""Kept of a series, zero included: steps of 12 degrees, finer than spectra of a surface hold."""

_TURNS = 180
_TURN_DEG = 180.0 / _TURNS

Array = npt.NDArray[Any]
Complex = npt.NDArray[np.complex64]


class LeastError(NamedTuple):
    """Least squared difference over all turns.

    `errors` (n,) float64; `shifts_deg` (n,) anticlockwise from the reference to the test;
    `sharpness` (n,) how much of the directional part agrees at that turn: 0 where every angle is
    as good as another, 1 where one angle explains all.
    """

    errors: npt.NDArray[np.float64]
    shifts_deg: npt.NDArray[np.float64]
    sharpness: npt.NDArray[np.float64]


def harmonics(polar: npt.NDArray[np.floating[Any]]) -> Complex:
    """(..., A) real maps over half a turn to (..., 16) complex64 series of equal energy.

    The sum of |c|^2 over the series is the sum of squares over the angles, less what lies in
    finer harmonics (Parseval).
    """
    series = scipy.fft.rfft(polar, norm="ortho")[..., :HARMONICS]
    # A real map has its negative harmonics too.
    series[..., 1:] *= np.sqrt(2.0)
    return np.ascontiguousarray(series, np.complex64)


def least_error(test: Complex, references: Complex) -> LeastError:
    """Compare one stack of maps with n others over all common turns.

    Parameters
    ----------
    test
        (K, 16) series.
    references
        (n, K, 16) series.
    """
    cross = np.empty((len(references), HARMONICS), np.complex128)
    energies = np.empty(cross.shape, np.float64)
    count, maps, length = references.shape
    run_on_rows(partial(_products, test, references, cross, energies), (count, maps * length))
    padded = np.zeros((len(cross), _TURNS // 2 + 1), np.complex128)
    padded[:, :HARMONICS] = cross
    padded[:, 1:] *= 0.5
    correlations = scipy.fft.irfft(padded, n=_TURNS, norm="forward")
    energies += _squares(test).sum(axis=0, dtype=np.float64)
    total = energies.sum(axis=1)
    errors = total[:, None] - 2.0 * correlations
    row = np.arange(len(errors))
    best = np.argmin(errors, axis=1)
    before, least, after = (errors[row, (best + step) % _TURNS] for step in (-1, 0, 1))
    curvature = before - 2.0 * least + after
    flat = curvature <= 1e-9 * total + 1e-30
    offset = np.where(flat, 0.0, 0.5 * (before - after) / np.where(flat, 1.0, curvature))
    least = np.maximum(least - 0.25 * (before - after) * offset, 0.0)
    # Without harmonic 0, which no turn changes: how far the directions agree, once turned.
    directional = energies[:, 1:].sum(axis=1)
    agreed = 2.0 * (correlations.max(axis=1) - cross[:, 0].real)
    sharpness = np.clip(agreed / np.maximum(directional, np.finfo(np.float64).tiny), 0.0, 1.0)
    # Twice: a hair below 0 is rounded up to a whole turn.
    shifts_deg = ((best + offset) % _TURNS % _TURNS) * _TURN_DEG
    return LeastError(errors=least, shifts_deg=shifts_deg, sharpness=sharpness)


def shift_invariant_norms(series: Complex) -> FloatMap:
    """(..., K, 16) series to (..., 2 K) float32 that no turn changes.

    The real harmonic 0 of each map and the norm of all its others. The Euclidean distance of two
    such vectors is at most the least error's square root (triangle inequality).
    """
    norms: FloatMap = np.concatenate(
        [series[..., 0].real, np.sqrt(_squares(series[..., 1:]).sum(axis=-1))], axis=-1
    ).astype(np.float32)
    return norms


def _squares(series: Complex) -> npt.NDArray[np.float32]:
    return series.real**2 + series.imag**2


@kernel
def _products(
    test: Array, references: Array, cross: Array, energies: Array, first: int, stop: int
) -> None:
    """Sums over k of test times conjugate reference, and of the reference's squares, (n, 16)."""
    _, maps, length = references.shape
    for n in range(first, stop):
        sums = np.zeros((3, length), np.float64)
        for k in range(maps):
            for h in range(length):
                t, r = test[k, h], references[n, k, h]
                sums[0, h] += t.real * r.real + t.imag * r.imag
                sums[1, h] += t.imag * r.real - t.real * r.imag
                sums[2, h] += r.real * r.real + r.imag * r.imag
        for h in range(length):
            cross[n, h] = complex(sums[0, h], sums[1, h])
            energies[n, h] = sums[2, h]
