"""Scheme 9.3 of the thesis: turn by the 1D polar spectra, decide by the 2D spectra."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .orientation import STEP_DEG, roll_angles, squared_errors_by_turn, turn_of_least_error
from .spectra import Spectra
from .surface import FloatMap

__all__ = ["Reference", "compare", "signature"]


@dataclass(frozen=True, eq=False)
class Reference:
    """One training set: its class, its signature (2, R, A) and the orientation it lay in."""

    label: str
    signature: FloatMap
    orientation_deg: float


def signature(spectra: Spectra) -> FloatMap:
    """(2, R, A) float32: what a library keeps of a surface, magnitude spectra of M and A.

    The thesis leaves power or magnitude open, and how gradient weighs against albedo. Magnitudes
    are kept, because a few strong low frequencies outvote all others in a power spectrum. Each
    row is weighted by its frequency, which makes slope^2 and albedo^2 per octave comparable.
    """
    density = np.stack([spectra.gradient, spectra.albedo])
    per_octave = np.square(spectra.radii_cpp).astype(np.float32)[:, None]
    magnitude: FloatMap = np.sqrt(density * per_octave)
    return magnitude


def compare(
    test: FloatMap, references: FloatMap
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Distance and turn of one signature against n references.

    For each reference the 1D polar spectra of M and A give the turn of least squared error; the
    2D spectra, turned by it, give the total squared error (thesis scheme 9.3). The error is
    divided by the energy of both signatures, for M and A separately, so that it lies between
    0 and 1 and a rough texture cannot drown a smooth one.

    Parameters
    ----------
    test
        (2, R, A) signature.
    references
        (n, 2, R, A) signatures.

    Returns
    -------
    distances
        (n,) float64 in [0, 1].
    turns_deg
        (n,) float64, anticlockwise turn from the reference to the test, [0, 180).
    """
    errors_1d = np.zeros((len(references), test.shape[-1]))
    for channel in range(2):
        polar = test[channel].sum(axis=0)
        reference_polar = references[:, channel].sum(axis=1)
        energy = np.sum(np.square(polar, dtype=np.float64)) + np.sum(
            np.square(reference_polar, dtype=np.float64), axis=1
        )
        errors = squared_errors_by_turn(polar, reference_polar)
        errors_1d += errors / np.maximum(energy, np.finfo(np.float64).tiny)[:, None]
    turns = turn_of_least_error(errors_1d)

    turned = roll_angles(test, turns)
    difference = np.square(turned - references).sum(axis=(2, 3))
    energy = np.square(turned).sum(axis=(2, 3)) + np.square(references, dtype=np.float64).sum(
        axis=(2, 3)
    )
    shares = difference / np.maximum(energy, np.finfo(np.float64).tiny)
    return shares.mean(axis=1), turns * STEP_DEG
