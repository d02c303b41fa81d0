"""The 1D classifiers: polar spectra, alone or with radial spectra (thesis chapters 6 to 8)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from classify.errors import InputError
from classify.surface.estimate import FloatMap, SurfaceEstimate
from classify.texture.orientation import STEP_DEG, best_shift, roll_angles, squared_errors_by_shift
from classify.texture.spectra import ANGLES, image_spectrum, polar_radii_px

from .classifier import Comparison, Parameters, simple_classifier
from .spectra_2d import PolarSpectra, observe_spectra, shifts_by_polar

__all__ = ["IMAGE_POLAR", "POLAR", "POLAR_RADIAL", "first_light", "images_of"]


def images_of(surface: SurfaceEstimate) -> npt.NDArray[np.generic]:
    """(N, H, W) images of a surface.

    Raises
    ------
    InputError
        If the surface came without its images.
    """
    if surface.images is None:
        raise InputError(
            "this surface comes without its images, and this classifier compares images; "
            "solve the set again"
        )
    return surface.images


def first_light(surface: SurfaceEstimate) -> int:
    """Index of the light nearest to tilt 0, whose image is compared."""
    return 0 if surface.lighting is None else surface.lighting.light_nearest_tilt(0.0, 180.0)


def _observe_image(surface: SurfaceEstimate, segment_px: int) -> PolarSpectra:
    image = images_of(surface)[first_light(surface)]
    spectrum = image_spectrum(image, segment_px)
    octaves = np.square(polar_radii_px(segment_px) / segment_px).astype(np.float32)[:, None]
    return PolarSpectra((spectrum * octaves)[None])


def _polar(observation: PolarSpectra, _: Parameters) -> FloatMap:
    """(A,) magnitudes of the first channel, summed over radius (thesis section 6.4)."""
    polar: FloatMap = np.sqrt(observation.per_octave[0]).sum(axis=0)
    return polar


def _compare_polar(test: FloatMap, references: FloatMap, _: Parameters) -> Comparison:
    """Least squared error over all shifts, relative to the energy of both."""
    errors = squared_errors_by_shift(test, references)
    energy = _energy(test[None]) + _energy(references)
    shifts = best_shift(errors)
    return Comparison(np.maximum(errors.min(axis=1), 0.0) / energy, shifts * STEP_DEG)


def _profiles(observation: PolarSpectra, _: Parameters) -> FloatMap:
    """(2, A + R) of M and A: polar and radial magnitudes (thesis chapter 8)."""
    magnitude = np.sqrt(observation.per_octave)
    return np.concatenate([magnitude.sum(axis=1), magnitude.sum(axis=2)], axis=1)


def _compare_profiles(test: FloatMap, references: FloatMap, _: Parameters) -> Comparison:
    """Mean of four relative errors: polar and radial, of M and of A, under one polar shift."""
    polar, radial = test[:, :ANGLES], test[:, ANGLES:]
    polar_references, radial_references = references[..., :ANGLES], references[..., ANGLES:]
    shifts = shifts_by_polar(polar[:, None], polar_references[:, :, None])
    shifted = roll_angles(polar, shifts)
    shares = [
        np.square(one[:, channel] - other[:, channel], dtype=np.float64).sum(axis=-1)
        / (_energy(one[:, channel]) + _energy(other[:, channel]))
        for one, other in (
            (shifted, polar_references),
            (np.broadcast_to(radial, radial_references.shape), radial_references),
        )
        for channel in range(2)
    ]
    return Comparison(np.mean(shares, axis=0), shifts * STEP_DEG)


def _energy(rows: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    """(n,) sums of squares, made positive."""
    sums: npt.NDArray[np.float64] = np.square(rows, dtype=np.float64).sum(axis=-1)
    sums += np.finfo(np.float64).tiny
    return sums


IMAGE_POLAR = simple_classifier(
    "image_polar", _observe_image, _polar, _compare_polar, from_images=True
)
POLAR = simple_classifier("polar", observe_spectra, _polar, _compare_polar)
POLAR_RADIAL = simple_classifier("polar_radial", observe_spectra, _profiles, _compare_profiles)
