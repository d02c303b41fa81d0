"""What the joint classifier keeps of a surface: polar spectra and local statistics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from classify.surface.estimate import FloatMap, SurfaceEstimate
from classify.texture.fields import TextureFields, texture_fields
from classify.texture.rotated_lights import under_rotated_lights
from classify.texture.spectra import Spectra, field_spectra
from classify.texture.statistics import LocalStatistics, levels_for, local_statistics

from .classifier import Observation

__all__ = ["JointObservation", "JointTraining", "observe", "observe_training"]


@dataclass(frozen=True, eq=False)
class JointObservation(Observation):
    """One surface.

    Attributes
    ----------
    polar
        (3, R, A) float32 densities: relief, albedo, co-spectrum.
    curl_density
        Mean density of the curl, which a relief does not have: the error of the gradient.
    statistics
        Of the frame and its quarters.
    pixels
        In the frame.
    """

    polar: FloatMap
    curl_density: float
    statistics: LocalStatistics
    pixels: int


@dataclass(frozen=True, eq=False)
class JointTraining(Observation):
    """One training set.

    Attributes
    ----------
    frame
        The surface.
    quarters
        (4, 3, R, A) float32 `polar` of each quarter of the frame.
    rotated
        The surface as seen under rotated lights; empty where that changes nothing.
    """

    frame: JointObservation
    quarters: FloatMap
    rotated: tuple[JointObservation, ...]


def observe(surface: SurfaceEstimate, segment_px: int) -> JointObservation:
    """Observe a surface with segments of that side."""
    return _observe_fields(texture_fields(surface), segment_px)


def observe_training(surface: SurfaceEstimate, segment_px: int) -> JointTraining:
    """Observe a training set: the frame, its quarters, and the frame under rotated lights."""
    fields = texture_fields(surface)
    rows, columns = fields.shape
    quarters = [
        TextureFields(fields.p[cut], fields.q[cut], fields.albedo[cut])
        for top in (0, rows // 2)
        for left in (0, columns // 2)
        for cut in [np.s_[top : top + rows // 2, left : left + columns // 2]]
    ]
    return JointTraining(
        frame=_observe_fields(fields, segment_px),
        quarters=np.stack([_polar(field_spectra(each, segment_px // 2)) for each in quarters]),
        rotated=tuple(observe(other, segment_px) for other in under_rotated_lights(surface)),
    )


def _observe_fields(fields: TextureFields, segment_px: int) -> JointObservation:
    spectra = field_spectra(fields, segment_px)
    return JointObservation(
        polar=_polar(spectra),
        curl_density=spectra.curl_density,
        statistics=local_statistics(fields, levels_for(segment_px)),
        pixels=fields.p.size,
    )


def _polar(spectra: Spectra) -> FloatMap:
    return np.stack([spectra.relief, spectra.albedo, spectra.co_spectrum])
