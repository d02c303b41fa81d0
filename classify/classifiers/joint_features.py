"""Features of the joint classifier: observations, series and statistics.

``tests/evidence/joint_constants.py`` prints the errors with each tuned number halved and doubled.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from classify.base.arrays import FloatMap, Floats
from classify.base.threads import in_background
from classify.relief.relighting import under_rotated_lights
from classify.surface.estimate import SurfaceEstimate
from classify.texture.blur import KNOTS_PX2, blur_gains, blurred_fields
from classify.texture.fields import TextureFields, texture_fields
from classify.texture.orientation import Complex, harmonics
from classify.texture.segment_powers import require_segment
from classify.texture.spectra import RADII, Spectra, field_spectra, polar_radii_px
from classify.texture.statistics import (
    QUARTERS,
    LocalStatistics,
    levels_for,
    local_statistics,
    statistics_vector,
)
from classify.texture.uniformity import unevenness

from . import Observation, Parameters

# Weights of log relief, log albedo and coherence. The coherence of two equal spectra has a quarter
# of the variance of a logarithm of power.
_CHANNEL_WEIGHTS = (1.0, 1.0, 4.0)
CHANNELS = len(_CHANNEL_WEIGHTS)
SERIES = CHANNELS * RADII
"""Number of Fourier series in a signature: one for each channel and radius."""

SPECTRAL_SHARE = "spectral_share"
"""Parameter: weight of the distance of spectra; 1 minus it is that of the statistics."""

CONTRAST_GAINS = "contrast_gains"
"""Parameter: factor of the contrast of each channel in a distance."""

RING_CAP = "ring_cap"
"""Parameter: radius in bins up to which the weight of a ring grows with its radius."""

# Share of the power of relief that counts as power of albedo. Penumbra, gloss and LEDs that are
# 5 % weaker than assumed leak about as much of the relief into the albedo.
_ALBEDO_LEAK = 0.004
# Variance of the albedo response over that of the curl response, level by level, for white noise of
# equal density in slopes and albedo (test_statistics.py measures it).
ALBEDO_GAINS = (4.06, 6.20, 7.18, 7.56, 8.23)
_QUARTER_PAIRS = tuple((i, j) for i in range(QUARTERS) for j in range(i))


@dataclass(frozen=True, eq=False)
class JointObservation(Observation):
    """One surface: its polar spectra and local statistics."""

    polar: FloatMap  # (3, R, A) densities: relief, albedo, co-spectrum
    curl_density: float  # mean density of the curl: the error of the gradient
    statistics: LocalStatistics
    pixels: int  # of the frame
    segment_px: int  # side of the segments of the spectra


@dataclass(frozen=True, eq=False)
class JointTraining(Observation):
    """Features of one training set."""

    frame: JointObservation
    quarters: FloatMap  # (4, 3, R, A) `polar` of its quarters
    rotated: tuple[JointObservation, ...]  # under rotated lights, if shadows make it differ
    blurred: tuple[LocalStatistics, ...]  # after a blur by each of `KNOTS_PX2`
    unevenness: float  # see `texture.uniformity`


def observe(surface: SurfaceEstimate, segment_px: int) -> JointObservation:
    """Observe a surface, with segments of `segment_px` in its spectra."""
    return _observe_fields(texture_fields(surface), segment_px)


def observe_training(surface: SurfaceEstimate, segment_px: int) -> JointTraining:
    """Observe a training set: frame, quarters, rotated lights and blurred frames."""
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
        quarters=np.stack(
            [_polar(field_spectra(quarter, segment_px // 2)) for quarter in quarters]
        ),
        rotated=tuple(observe(other, segment_px) for other in under_rotated_lights(surface)),
        blurred=tuple(
            local_statistics(blurred_fields(fields, variance_px2), levels_for(segment_px))
            for variance_px2 in KNOTS_PX2
        ),
        unevenness=unevenness(fields),
    )


def _observe_fields(fields: TextureFields, segment_px: int) -> JointObservation:
    require_segment(fields.shape, segment_px)  # before other work begins
    wait_for_statistics = in_background(partial(local_statistics, fields, levels_for(segment_px)))
    spectra = field_spectra(fields, segment_px)
    return JointObservation(
        polar=_polar(spectra),
        curl_density=spectra.curl_density,
        statistics=wait_for_statistics(),
        pixels=fields.p.size,
        segment_px=segment_px,
    )


def _polar(spectra: Spectra) -> FloatMap:
    return np.stack([spectra.relief, spectra.albedo, spectra.co_spectrum])


def spectral_series(polar: FloatMap, parameters: Parameters) -> Complex:
    """(..., SERIES, 16) Fourier series of the weighted channels of (..., 3, R, A) densities."""
    return harmonics(_channels(polar, parameters))


def contrasts(polar: FloatMap, parameters: Parameters) -> FloatMap:
    """(..., 3) contrasts of (..., 3, R, A) densities: weighted sums over all rings."""
    weights = _root_weights(parameters)
    return _weighted_sums(_weighted_channels(polar, parameters, weights), weights)


def _weighted_sums(channels: FloatMap, weights: FloatMap) -> FloatMap:
    """(..., 3) sums of weighted channels over rings and angles."""
    sums = np.einsum("cr,...cra->...c", _unit_weights(weights), channels)
    return np.asarray(sums / np.float32(np.sqrt(channels.shape[-1])), np.float32)


def _channels(polar: FloatMap, parameters: Parameters) -> FloatMap:
    """(..., SERIES, A) weighted log relief, log albedo and coherence, with less contrast."""
    weights = _root_weights(parameters)
    channels = _weighted_channels(polar, parameters, weights)
    factors = (parameters[CONTRAST_GAINS] - 1.0) / np.sqrt(polar.shape[-1])
    changes = factors.astype(np.float32) * _weighted_sums(channels, weights)
    channels += (changes[..., None] * _unit_weights(weights))[..., None]
    return channels.reshape(*polar.shape[:-3], SERIES, polar.shape[-1])


def _weighted_channels(polar: FloatMap, parameters: Parameters, weights: FloatMap) -> FloatMap:
    floor = np.float32(parameters["density_floor"])
    relief = polar[..., 0, :, :] + floor
    albedo = polar[..., 1, :, :] + np.float32(_ALBEDO_LEAK) * polar[..., 0, :, :] + floor
    channels = np.stack(
        [np.log(relief), np.log(albedo), polar[..., 2, :, :] / np.sqrt(relief * albedo)], axis=-3
    )
    channels *= weights[..., None]
    return channels


def _unit_weights(weights: FloatMap) -> FloatMap:
    """(3, R) weights of rings in the contrast of each channel; their squares have sum 1."""
    return np.asarray(weights / np.linalg.norm(weights, axis=1, keepdims=True), np.float32)


def _root_weights(parameters: Parameters) -> FloatMap:
    """(3, R) roots of the weights of the rings of each channel."""
    # Radii in bins of 128 px segments; in other segments only the last rings have other radii.
    bins = np.minimum(polar_radii_px(128), parameters[RING_CAP])
    weights = np.outer(_CHANNEL_WEIGHTS, bins)
    roots: FloatMap = np.sqrt(weights / weights.sum()).astype(np.float32)
    return roots


def blur_curve(
    observation: JointObservation, blurred: Sequence[LocalStatistics], parameters: Parameters
) -> FloatMap:
    """(knots, SERIES + d) changes of the means of rings and of the statistics by blur."""
    radii_cpp = polar_radii_px(observation.segment_px) / observation.segment_px
    gains = np.concatenate([np.ones((1, RADII), np.float32), blur_gains(radii_cpp)])
    polar = observation.polar * gains[:, None, :, None]
    means = _channels(polar, parameters).sum(axis=-1) / np.sqrt(polar.shape[-1])
    rings = spectral_unit(parameters) * (means[1:] - means[0])
    whitening = local_unit(parameters) * parameters["whitening"]
    local = np.zeros((len(rings), len(whitening)))
    if blurred:
        frame = statistics_rows(observation.statistics, parameters)[0]
        rows = [statistics_rows(statistics, parameters)[0] for statistics in blurred]
        local[:] = [whitening @ (row - frame) for row in rows]
    return np.concatenate([rings, local], axis=1, dtype=np.float32)


def spectral_unit(parameters: Parameters) -> float:
    """Factor of series that makes the mean distance between quarters `spectral_share`."""
    return float(np.sqrt(parameters[SPECTRAL_SHARE] / parameters["spectral_scatter"]))


def local_unit(parameters: Parameters) -> float:
    """Factor of whitened statistics that makes the mean distance 1 - `spectral_share`."""
    return float(np.sqrt((1.0 - parameters[SPECTRAL_SHARE]) / parameters["local_scatter"]))


def statistics_rows(statistics: LocalStatistics, parameters: Parameters) -> Floats:
    """(5, d) statistics of the frame and its quarters; see `statistics_vector`."""
    leaks = _ALBEDO_LEAK * np.array(ALBEDO_GAINS[: statistics.levels])
    return statistics_vector(
        statistics, parameters["relief_floors"], parameters["albedo_floors"], leaks
    )


def quarter_distances(
    trainings: Sequence[JointTraining],
    statistics: Floats,
    parameters: Parameters,
) -> tuple[Floats, Floats]:
    """(sets, 6) squared distances between quarters, of spectra and (sets, 5, d) statistics."""
    whitened = statistics[:, 1:] @ parameters["whitening"].T
    local = np.stack(
        [np.square(whitened[:, i] - whitened[:, j]).sum(axis=1) for i, j in _QUARTER_PAIRS], axis=1
    )
    spectral = np.empty((len(trainings), len(_QUARTER_PAIRS)))
    for row, training in zip(spectral, trainings, strict=True):
        series = spectral_series(training.quarters, parameters)
        row[:] = [np.square(np.abs(series[i] - series[j])).sum() for i, j in _QUARTER_PAIRS]
    return spectral, local


def combined_distances(spectral: Floats, local: Floats, parameters: Parameters) -> Floats:
    """Weighted sum of both squared distances, in units of the mean between quarters."""
    share = float(parameters[SPECTRAL_SHARE])
    return (
        share * spectral / parameters["spectral_scatter"]
        + (1.0 - share) * local / parameters["local_scatter"]
    )
