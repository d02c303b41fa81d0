"""The classifiers of the thesis: 1D spectra (chapters 6 to 8), 2D spectra (9)."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from classify.base.arrays import FloatMap, Floats
from classify.base.errors import InputError
from classify.surface.estimate import SurfaceEstimate
from classify.texture.orientation import (
    ANGLE_STEP_DEG,
    best_shift,
    roll_angles,
    squared_errors_by_shift,
)
from classify.texture.spectra import ANGLES, image_spectrum, polar_radii_px, surface_spectra

from . import Comparison, Observation, Parameters, simple_classifier


@dataclass(frozen=True, eq=False)
class PolarSpectra(Observation):
    """(channels, R, A) float32 power spectra per octave; a surface has two, M and A."""

    per_octave: FloatMap


def _observe(surface: SurfaceEstimate, segment_px: int) -> PolarSpectra:
    """Spectra M and A times frequency squared: slope^2 and albedo^2 per octave."""
    spectra = surface_spectra(surface, segment_px)
    density = np.stack([spectra.gradient, spectra.albedo])
    return PolarSpectra(density * np.square(spectra.radii_cpp).astype(np.float32)[:, None])


def images_of(surface: SurfaceEstimate) -> npt.NDArray[np.generic]:
    """(N, H, W) images of a surface, as solved; InputError if it came without them."""
    images = surface.solved_images
    if images is None:
        raise InputError(
            "this surface comes without its images, or has a mask, and this classifier compares "
            "images; solve the set again, without a mask"
        )
    return images


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
    return Comparison(np.maximum(errors.min(axis=1), 0.0) / energy, shifts * ANGLE_STEP_DEG)


def _profiles(observation: PolarSpectra, _: Parameters) -> FloatMap:
    """(2, A + R) of M and A: polar and radial magnitudes (thesis chapter 8)."""
    magnitude = np.sqrt(observation.per_octave)
    return np.concatenate([magnitude.sum(axis=1), magnitude.sum(axis=2)], axis=1)


def _compare_profiles(test: FloatMap, references: FloatMap, _: Parameters) -> Comparison:
    """Mean relative error of polar and radial spectra, of M and A, at one shift."""
    polar, radial = test[:, :ANGLES], test[:, ANGLES:]
    polar_references, radial_references = references[..., :ANGLES], references[..., ANGLES:]
    shifts = _shifts_by_polar(polar[:, None], polar_references[:, :, None])
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
    return Comparison(np.mean(shares, axis=0), shifts * ANGLE_STEP_DEG)


def _energy(rows: npt.NDArray[np.floating]) -> Floats:
    """(n,) sums of squares, made positive."""
    sums: Floats = np.square(rows, dtype=np.float64).sum(axis=-1)
    sums += np.finfo(np.float64).tiny
    return sums


def _shifts_by_polar(test: FloatMap, references: FloatMap) -> Floats:
    """(n,) shifts of least squared error between 1D polar spectra, in grid steps."""
    errors_1d = np.zeros((len(references), test.shape[-1]))
    for channel in range(2):
        polar = test[channel].sum(axis=0)
        reference_polar = references[:, channel].sum(axis=1)
        energy = _energy(polar[None]) + _energy(reference_polar)
        errors_1d += squared_errors_by_shift(polar, reference_polar) / energy[:, None]
    return best_shift(errors_1d)


def _magnitude(observation: PolarSpectra, _: Parameters) -> FloatMap:
    """Magnitudes: in powers a few strong low frequencies outweigh all others."""
    return np.sqrt(observation.per_octave)


def _power(observation: PolarSpectra, _: Parameters) -> FloatMap:
    return observation.per_octave


def _compare_2d(test: FloatMap, references: FloatMap, _: Parameters) -> Comparison:
    """Distances of one (2, R, A) signature to n references (thesis scheme 9.3)."""
    # The shift is that of the least squared error of the 1D spectra. The error of each 2D spectrum
    # is divided by both energies.
    shifts = _shifts_by_polar(test, references)
    shifted = roll_angles(test, shifts)
    difference = np.square(shifted - references).sum(axis=(2, 3))
    energy = np.square(shifted).sum(axis=(2, 3)) + np.square(references, dtype=np.float64).sum(
        axis=(2, 3)
    )
    shares = difference / np.maximum(energy, np.finfo(np.float64).tiny)
    return Comparison(shares.mean(axis=1), shifts * ANGLE_STEP_DEG)


IMAGE_POLAR = simple_classifier(
    "image_polar", _observe_image, _polar, _compare_polar, from_images=True
)
POLAR = simple_classifier("polar", _observe, _polar, _compare_polar)
POLAR_RADIAL = simple_classifier("polar_radial", _observe, _profiles, _compare_profiles)
SPECTRA_2D = simple_classifier("spectra_2d", _observe, _magnitude, _compare_2d)
SPECTRA_2D_POWER = simple_classifier("spectra_2d_power", _observe, _power, _compare_2d)
