"""The circular shift between polar maps, which is the orientation of a surface.

The thesis correlates spectra on the grid of angles. The joint classifier compares Fourier series in
the angle: a map over 180 degrees is f(theta) = sum_m c_m exp(2 i m theta), and a circular shift by
phi multiplies c_m by exp(-2 i m phi). The squared difference of two maps for every phi is one short
inverse transform of sum c_m conj(d_m). The moduli |c_m| do not depend on phi and give a lower bound
for all shifts.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, FloatMap, Floats
from classify.base.compiling import kernel
from classify.base.threads import run_on_rows

from .spectra import ANGLES

ANGLE_STEP_DEG = 180.0 / ANGLES


def squared_errors_by_shift(
    test: npt.NDArray[np.floating], references: npt.NDArray[np.floating]
) -> Floats:
    """(n, A) sums of (test(theta + phi) - reference(theta))^2 by phi, by FFT (thesis 6.4.6).

    Entry j shifts the reference by j steps anticlockwise.
    """
    middle_axes = tuple(range(1, references.ndim - 1))
    cross = np.fft.rfft(test.astype(np.float64)) * np.conj(
        np.fft.rfft(references.astype(np.float64))
    )
    correlation = np.fft.irfft(cross.sum(axis=middle_axes), n=test.shape[-1])
    energy = np.sum(np.square(test, dtype=np.float64)) + np.sum(
        np.square(references, dtype=np.float64), axis=(*middle_axes, references.ndim - 1)
    )
    errors: Floats = energy[:, None] - 2.0 * correlation
    return errors


def best_shift(errors: Floats) -> Floats:
    """(n,) shift in grid steps at the lowest of (n, A) errors, refined by a parabola."""
    shifts, _ = _refined_minima(errors, 1e-12 * np.abs(errors.min(axis=-1)))
    return np.mod(shifts, errors.shape[-1])


def _refined_minima(errors: Floats, flat_below: Floats) -> tuple[Floats, Floats]:
    """(n,) positions and values of the minima of (n, A) periodic errors, by a parabola.

    A curvature up to `flat_below` is rounding: such a minimum is not refined.
    """
    count = errors.shape[-1]
    lowest = np.argmin(errors, axis=-1)
    row = np.arange(len(errors))
    before, minima, after = (errors[row, (lowest + step) % count] for step in (-1, 0, 1))
    curvature = before - 2.0 * minima + after
    flat = curvature <= flat_below + 1e-30  # also where all errors are 0
    offset = np.where(flat, 0.0, 0.5 * (before - after) / np.where(flat, 1.0, curvature))
    return lowest + offset, minima - 0.25 * (before - after) * offset


def roll_angles(polar: npt.NDArray[np.floating], shifts: Floats) -> Floats:
    """(n, ..., A) `polar` (..., A), shifted to smaller angles by (n,) `shifts` in grid steps.

    Shifts by fractions of a step interpolate, by a Fourier phase ramp.
    """
    transform = np.fft.rfft(polar.astype(np.float64))
    order = np.arange(transform.shape[-1])
    count = polar.shape[-1]
    ramp = np.exp(2j * np.pi * order * shifts[:, None] / count)
    ramp = ramp.reshape(len(shifts), *(1,) * (polar.ndim - 1), -1)
    shifted: Floats = np.fft.irfft(transform * ramp, n=count)
    return shifted


# Sharpness below which a texture determines no orientation. tests/evidence/orientation_flags.py
# prints how often correct and mistyped orientations of 52 textures are flagged.
MIN_SHARPNESS = 0.45


@dataclass(frozen=True, eq=False)
class OrientationProfile:
    """Agreement of a surface with a reference, by orientation."""

    agreement: Floats  # (180,) at 0 to 179 degrees; 1 equal, 0 unrelated

    def best(self, near_deg: float = 0.0, within_deg: float = 90.0) -> tuple[float, float]:
        """Return the best orientation near `near_deg`, in [0, 180), and its agreement."""
        distance_deg = np.abs((np.arange(180) - near_deg + 90.0) % 180.0 - 90.0)
        allowed = np.where(distance_deg <= within_deg, self.agreement, -np.inf)
        index = int(np.argmax(allowed))
        # A peak is refined by a parabola; the end of the allowed range need not be a peak.
        around = self.agreement[[index - 1, index, (index + 1) % 180]]
        if around.argmax() != 1:
            return float(index), float(around[1])
        offset, minima = _refined_minima(-around[None, :], np.zeros(1))
        return float((index - 1 + offset[0]) % 180.0), float(-minima[0])


HARMONICS = 16
"""Harmonics of a series, zero included: the highest has a period of 12 degrees."""

# Shifts that are compared, one degree apart; a parabola refines the best of them.
_SHIFTS = 180
_SHIFT_STEP_DEG = 180.0 / _SHIFTS
# Relative curvature below which rounding decides, so that the parabola has no vertex.
_MIN_CURVATURE = 1e-9

Complex = npt.NDArray[np.complex64]


class _LeastError(NamedTuple):
    """Least squared difference over all shifts, of one stack of maps and n references."""

    errors: Floats  # (n,)
    shifts_deg: Floats  # (n,) from reference to test, anticlockwise, [0, 180)
    sharpness: Floats  # (n,) share of directional energy that agrees, 0 to 1


def harmonics(polar: npt.NDArray[np.floating[Any]]) -> Complex:
    """(..., 16) complex64 series of (..., A) real maps over 180 degrees."""
    series = np.fft.rfft(polar, norm="ortho")[..., :HARMONICS]
    # A real map has negative harmonics of the same modulus.
    series[..., 1:] *= np.sqrt(2.0)
    return np.ascontiguousarray(series, np.complex64)


def least_error(test: Complex, references: Complex) -> _LeastError:
    """Compare a stack of K maps, (K, 16) series, with n stacks, (n, K, 16).

    The maps of a stack are shifted by one angle.
    """
    correlations, zeroth, energies = _correlations(test, references)
    total = energies.sum(axis=1)
    errors = total[:, None] - 2.0 * correlations
    shifts, minima = _refined_minima(errors, _MIN_CURVATURE * total)
    sharpness = np.clip(_agreement(correlations.max(axis=1), zeroth, energies), 0.0, 1.0)
    # The second modulo: a remainder of -1e-17 is rounded up to 180.
    shifts_deg = (shifts % _SHIFTS % _SHIFTS) * _SHIFT_STEP_DEG
    return _LeastError(np.maximum(minima, 0.0), shifts_deg, sharpness)


def agreement_by_shift(test: Complex, references: Complex) -> Floats:
    """(n, 180) agreement of the directional harmonics, 1 to 15, at shifts of 0 to 179 degrees.

    It is the share of their energy that agrees.
    """
    correlations, zeroth, energies = _correlations(test, references)
    return _agreement(correlations.T, zeroth, energies).T


def _agreement(correlations: Floats, zeroth: Floats, energies: Floats) -> Floats:
    """(..., n) share of the energy of the directional harmonics that agrees, of n references."""
    directional = np.maximum(energies[:, 1:].sum(axis=1), np.finfo(np.float64).tiny)
    agreed: Floats = 2.0 * (correlations - zeroth) / directional
    return agreed


def _correlations(test: Complex, references: Complex) -> tuple[Floats, Floats, Floats]:
    """(n, 180) correlations by shift, (n,) of harmonic 0 alone, and (n, 16) energies.

    An energy is the sum of those of test and reference.
    """
    cross = np.empty((len(references), HARMONICS), np.complex128)
    energies = np.empty(cross.shape, np.float64)
    count, maps, length = references.shape
    run_on_rows(partial(_products, test, references, cross, energies), (count, maps * length))
    padded = np.zeros((len(cross), _SHIFTS // 2 + 1), np.complex128)
    padded[:, :HARMONICS] = cross
    # `harmonics` counts the negative harmonics in the positive ones; irfft adds them again.
    padded[:, 1:] *= 0.5
    correlations = np.fft.irfft(padded, n=_SHIFTS, norm="forward")
    energies += _squares(test).sum(axis=0, dtype=np.float64)
    return correlations, cross[:, 0].real, energies


def shift_invariant_norms(series: Complex) -> FloatMap:
    """(..., K, 16) series to (..., 2 K) norms, whose distance bounds the least error."""
    others = np.sqrt(_squares(series[..., 1:]).sum(axis=-1))
    return np.concatenate([series[..., 0].real, others], axis=-1, dtype=np.float32)


def _squares(series: Complex) -> FloatMap:
    return series.real**2 + series.imag**2


@kernel
def _products(
    test: Array, references: Array, cross: Array, energies: Array, first: int, stop: int
) -> None:
    """Sum test times conjugate reference, and reference squared, into (n, 16) arrays."""
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
