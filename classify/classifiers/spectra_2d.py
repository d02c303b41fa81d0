"""Scheme 9.3 of the thesis: shift by the 1D polar spectra, distance of the 2D spectra."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from classify.surface.estimate import FloatMap, SurfaceEstimate
from classify.texture.orientation import STEP_DEG, best_shift, roll_angles, squared_errors_by_shift
from classify.texture.spectra import Spectra, surface_spectra

from .classifier import Comparison, Observation, Parameters, simple_classifier

__all__ = [
    "SPECTRA_2D",
    "SPECTRA_2D_POWER",
    "PolarSpectra",
    "observe_spectra",
    "per_octave",
    "shifts_by_polar",
]


@dataclass(frozen=True, eq=False)
class PolarSpectra(Observation):
    """(channels, R, A) float32 power spectra per octave; a surface has two, M and A."""

    per_octave: FloatMap


def observe_spectra(surface: SurfaceEstimate, segment_px: int) -> PolarSpectra:
    """Spectra M and A of a surface, per octave."""
    return PolarSpectra(per_octave(surface_spectra(surface, segment_px)))


def per_octave(spectra: Spectra) -> FloatMap:
    """(2, R, A) float32: M and A times frequency squared.

    The thesis does not specify the weights of frequencies and of gradient against albedo. This
    gives slope^2 and albedo^2 per octave.
    """
    density = np.stack([spectra.gradient, spectra.albedo])
    power: FloatMap = density * np.square(spectra.radii_cpp).astype(np.float32)[:, None]
    return power


def shifts_by_polar(test: FloatMap, references: FloatMap) -> npt.NDArray[np.float64]:
    """(n,) shifts in grid steps of least squared error between 1D polar spectra of M and A."""
    return best_shift(_errors_1d(test, references))


def _magnitude(observation: PolarSpectra, _: Parameters) -> FloatMap:
    """Magnitudes; in a power spectrum a few strong low frequencies outweigh all others."""
    return np.sqrt(observation.per_octave)


def _power(observation: PolarSpectra, _: Parameters) -> FloatMap:
    return observation.per_octave


def _compare(test: FloatMap, references: FloatMap, _: Parameters) -> Comparison:
    """Distance and orientation of one (2, R, A) signature against n references.

    For each reference the 1D polar spectra of M and A give the shift of least squared error; the
    2D spectra, shifted by it, give the total squared error (thesis scheme 9.3). The error is
    divided by the energy of both signatures, for M and A separately, so that it lies between
    0 and 1 and M does not outweigh A.
    """
    shifts = shifts_by_polar(test, references)
    shifted = roll_angles(test, shifts)
    difference = np.square(shifted - references).sum(axis=(2, 3))
    energy = np.square(shifted).sum(axis=(2, 3)) + np.square(references, dtype=np.float64).sum(
        axis=(2, 3)
    )
    shares = difference / np.maximum(energy, np.finfo(np.float64).tiny)
    return Comparison(shares.mean(axis=1), shifts * STEP_DEG)


def _errors_1d(test: FloatMap, references: FloatMap) -> npt.NDArray[np.float64]:
    """(n, A) squared errors of the polar spectra for every shift, relative to their energy."""
    errors_1d = np.zeros((len(references), test.shape[-1]))
    for channel in range(2):
        polar = test[channel].sum(axis=0)
        reference_polar = references[:, channel].sum(axis=1)
        energy = np.sum(np.square(polar, dtype=np.float64)) + np.sum(
            np.square(reference_polar, dtype=np.float64), axis=1
        )
        errors = squared_errors_by_shift(polar, reference_polar)
        errors_1d += errors / np.maximum(energy, np.finfo(np.float64).tiny)[:, None]
    return errors_1d


SPECTRA_2D = simple_classifier("spectra_2d", observe_spectra, _magnitude, _compare)
SPECTRA_2D_POWER = simple_classifier("spectra_2d_power", observe_spectra, _power, _compare)
