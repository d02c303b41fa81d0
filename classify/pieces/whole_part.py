"""Measures of a whole part: its scale, its handedness, and the power in its octaves."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Self

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Floats
from classify.surface.estimate import FloatMap

from .features import OCTAVES, PRODUCTS, energy_columns

_Complex = npt.NDArray[np.complex128]

# Shrinkage of the covariance towards its diagonal: at least this, and more for few parts, whose
# correlations are mostly chance.
_LEAST_SHRINKAGE = 0.2
_LEAST_VARIANCE = 1e-10


@dataclass(frozen=True, eq=False)
class LinearMeasure:
    """How far the features of a part lie along a direction: (features - origin) @ weights.

    A part at `origin` measures 0, and one at `origin` + direction measures 1.
    """

    origin: Floats  # (d,)
    weights: Floats  # (d,)

    @classmethod
    def of(cls, good: Floats, direction: Floats, origin: Floats | None = None) -> Self:
        """Weights of the direction with the least variance on (n, d) good parts (Fisher 1936).

        `origin` is by default the mean of the good parts.
        """
        middle = good.mean(axis=0)
        deviations = good - middle
        covariance = deviations.T @ deviations / (len(good) - 1)
        variances = np.diag(np.diag(covariance) + _LEAST_VARIANCE)
        share = _LEAST_SHRINKAGE + (1.0 - _LEAST_SHRINKAGE) / (len(good) - 1)
        weights = np.linalg.solve((1.0 - share) * covariance + share * variances, direction)
        response = float(direction @ weights)
        if response > 0.0:
            weights /= response
        return cls(middle if origin is None else origin, weights)

    def of_part(self, features: Floats) -> float:
        """Measure of a part with (d,) features."""
        return float((features - self.origin) @ self.weights)


def scale_measure(good: Floats, direction: Floats) -> tuple[LinearMeasure, Floats]:
    """Measure of the logarithm of the scale, and the left-out measure of each good part.

    `direction` is the change of the features by a scale of e.
    """
    left_out = [
        LinearMeasure.of(np.delete(good, n, axis=0), direction).of_part(part)
        for n, part in enumerate(good)
    ]
    return LinearMeasure.of(good, direction), np.array(left_out)


def handedness_measure(good: Floats) -> tuple[LinearMeasure, Floats]:
    """Measure of handedness, 1 for good parts and -1 for mirrored ones, as `scale_measure`."""

    def measure(parts: Floats) -> LinearMeasure:
        return LinearMeasure.of(parts, parts.mean(axis=0), np.zeros(parts.shape[1]))

    left_out = [measure(np.delete(good, n, axis=0)).of_part(part) for n, part in enumerate(good)]
    return measure(good), np.array(left_out)


def octave_levels(moments: FloatMap) -> Floats:
    """Logarithms of the root mean square of slopes, then of log albedo, in each octave."""
    energies = moments.mean(axis=(0, 1), dtype=np.float64)[energy_columns()]
    return np.asarray(0.5 * np.log(np.maximum(energies, 1e-9)))


def pseudo_scalars(moments: FloatMap) -> Floats:
    """Numbers of a part that a rotation keeps, and that change their sign in a mirror.

    Angles between the directions of two octaves, or of relief and albedo: with u and v of equal
    spin, the imaginary part of conj(u) v, of cells and of means over the part.
    """
    squares, fourths, albedos = [], [], []
    for octave in range(OCTAVES):
        energy, c2, s2, c4, s4, albedo, pa, qa = np.moveaxis(
            moments[..., 2 + PRODUCTS * octave :][..., :PRODUCTS].astype(np.float64), -1, 0
        )
        unit = max(float(energy.mean()), 1e-12)
        squares.append((c2 + 1j * s2) / unit)
        fourths.append((c4 + 1j * s4) / unit)
        albedos.append((pa + 1j * qa) / np.sqrt(unit * max(float(albedo.mean()), 1e-12)))
    return np.array([*_angles_between(squares, fourths, albedos)])


def _angles_between(
    squares: list[_Complex], fourths: list[_Complex], albedos: list[_Complex]
) -> Iterator[float]:
    """Imaginary parts of conj(u) v of all pairs of fields with spin 1, 2 or 4."""
    means = [
        [np.asarray(field.mean()) for field in fields] for fields in (squares, fourths, albedos)
    ]
    for twos, fours, ones in ((squares, fourths, albedos), means):
        for fields in (
            ones,
            [*twos, *(field**2 for field in ones)],
            [*fours, *(field**2 for field in twos)],
        ):
            for u, v in combinations(fields, 2):
                yield float((u.conj() * v).imag.mean())
