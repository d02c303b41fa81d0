"""The classifier by default: polar spectra over all turns, and local statistics, in one distance.

Both parts are measured in units of how much one surface differs from itself: the four quarters
of every training set say how far spectra and statistics of one texture scatter, which numbers
scatter together, and which classes scatter more than others. No constant of a distance comes
from anywhere else.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from classify.surface.estimate import FloatMap, SurfaceEstimate
from classify.texture.angular_harmonics import (
    HARMONICS,
    Complex,
    harmonics,
    least_error,
    shift_invariant_norms,
)
from classify.texture.fields import TextureFields, texture_fields
from classify.texture.heading import (
    HEADING_FLOATS,
    heading_numbers,
    heading_scores,
    heading_variances,
)
from classify.texture.rotated_lights import under_rotated_lights
from classify.texture.spectra import RADII, Spectra, field_spectra
from classify.texture.statistics import (
    PARTS,
    LocalStatistics,
    levels_for,
    local_statistics,
    statistics_vector,
)

from .classifier import Classifier, Comparison, Observation, Parameters

__all__ = ["JOINT", "STATISTICS"]

# A density below this many times the mean error (the curl, which no relief has) counts as that:
# the logarithm of an error would weigh as much as that of a texture. Errors are those of the upper
# quartile of the training sets: where one has much shadow, others will once they are turned.
_FLOOR_ERRORS = 3.0
_LEAST_FLOOR = 1e-6
# The number of DFT cells on a ring grows with its radius, and so does what a ring can tell;
# beyond this many bins the rings of a geometric grid share their cells.
_CAP_BINS = 8.0
# A coherence scatters by a quarter of the variance of a logarithm of power.
_CHANNEL_WEIGHTS = (1.0, 1.0, 4.0)
_CHANNELS = len(_CHANNEL_WEIGHTS)
# Share of the statistics' distance beside that of the spectra.
_LOCAL_SHARE = 0.5
# Correlations between statistics are estimated from few quarters: half of each is believed.
_SHRINKAGE = 0.5
_LEAST_SCATTER = 0.01
# Between quarters of a surface with any noise it is 1 and more; smooth plates without noise differ
# by the rounding of single precision, which must not become the unit.
_LEAST_DISTANCE = 0.1
# A class that scatters more is given more room, by this power of its scatter: four quarters tell
# it to a factor of two or so, not better.
_SCATTER_POWER = 0.5
# Beyond this many times what one in a hundred distances between quarters reaches, a surface is none
# of the class. The quantile is believed as far as there are distances; `_TYPICAL_LIMIT` counts as
# `_TYPICAL_PAIRS` of them, for libraries of few sets.
_LIMIT_QUANTILE = 0.99
_LIMIT_MARGIN = 1.25
_TYPICAL_LIMIT = 2.4
_TYPICAL_PAIRS = 60
# Quarters of a smaller training set show too little of a coarse texture to tell how far two patches
# of it lie apart, and the limit goes out with the fourth root of what is missing at the side.
_TELLING_PX = 256
_MAX_LEFT_OUT = 200
# Where a turn is less clear than this it may be off by a right angle.
_DIRECTIONAL = 0.5
# A reference nearer than this to another of the same set tells nothing new.
_WORTH_KEEPING = 0.1
# Variance of the albedo response over that of the curl, for white noise of equal density.
_ALBEDO_GAINS = (4.06, 6.20, 7.18, 7.56, 8.23)

# Share of the power of relief that counts as power of albedo: half shadows, gloss and lights that
# are 5 % weaker than they are taken for let through about as much.
_ALBEDO_LEAK = 0.004

_PAIRS = tuple((i, j) for i in range(PARTS) for j in range(i))
_SERIES = _CHANNELS * RADII
_SERIES_FLOATS = 2 * _SERIES * HARMONICS
_HEADING = slice(-1 - HEADING_FLOATS, -1)
STATISTICS = slice(_SERIES_FLOATS, _HEADING.start)
"""Where the statistics of a signature stand."""


def _observe(surface: SurfaceEstimate, segment_px: int) -> Observation:
    fields = texture_fields(surface)
    return _observation(fields, segment_px)


def _observation(fields: TextureFields, segment_px: int) -> Observation:
    spectra = field_spectra(fields, segment_px)
    measured = local_statistics(fields, levels_for(segment_px))
    return {
        "polar": _stacked(spectra),
        "curl_density": np.array(spectra.curl_density),
        "moments": measured.moments,
        "energies": measured.energies,
        "headings": measured.headings,
        "pixels": np.array(float(fields.p.size)),
    }


def _observe_training(surface: SurfaceEstimate, segment_px: int) -> Observation:
    fields = texture_fields(surface)
    rows, columns = fields.shape
    quarters = [
        TextureFields(fields.p[cut], fields.q[cut], fields.albedo[cut])
        for top in (0, rows // 2)
        for left in (0, columns // 2)
        for cut in [np.s_[top : top + rows // 2, left : left + columns // 2]]
    ]
    spectra = [field_spectra(quarter, segment_px // 2) for quarter in quarters]
    turned = [_observe(other, segment_px) for other in under_rotated_lights(surface)]
    return {
        **_observation(fields, segment_px),
        "quarters": np.stack([_stacked(each) for each in spectra]),
        **{
            f"turned_{index}_{name}": values
            for index, each in enumerate(turned)
            for name, values in each.items()
        },
    }


def _stacked(spectra: Spectra) -> FloatMap:
    """(3, R, A): relief, albedo, co-spectrum."""
    return np.stack([spectra.relief, spectra.albedo, spectra.co_spectrum])


def _learn(observations: Sequence[Observation], _labels: Sequence[str]) -> Parameters:
    densities = [each["curl_density"] for each in observations]
    density_floor = max(_FLOOR_ERRORS * float(np.quantile(densities, 0.75)), _LEAST_FLOOR)
    curls = [each["moments"][0, :, 7] for each in observations]
    relief_floors = np.maximum(_FLOOR_ERRORS * np.quantile(curls, 0.75, axis=0), _LEAST_FLOOR)
    floors = {
        "density_floor": np.array(density_floor),
        "relief_floors": relief_floors,
        "albedo_floors": relief_floors * np.array(_ALBEDO_GAINS[: len(relief_floors)]),
    }
    # (sets, 1 + quarters, d)
    statistics = np.stack([_statistics(each, floors) for each in observations])
    deviations = statistics[:, 1:] - statistics[:, 1:].mean(axis=1, keepdims=True)
    flat = deviations.reshape(-1, deviations.shape[-1])
    covariance = flat.T @ flat / (len(observations) * (PARTS - 1))
    scatter = np.sqrt(np.diag(covariance)) + _LEAST_SCATTER
    correlation = (1.0 - _SHRINKAGE) * covariance / np.outer(scatter, scatter)
    np.fill_diagonal(correlation, 1.0)
    # |W (x - y)|^2 is the squared Mahalanobis distance.
    whitening = np.linalg.inv(np.linalg.cholesky(correlation)) / scatter
    spectral, local = _within(observations, statistics, floors, whitening)
    headings = [heading_variances(each["headings"]) for each in observations]
    learned = {
        **floors,
        "heading_variances": np.mean(headings, axis=0),
        "whitening": whitening,
        "pixels": np.array(np.median([each["pixels"] for each in observations])),
        "spectral_scatter": np.array(max(float(spectral.mean()), _LEAST_DISTANCE)),
        "local_scatter": np.array(max(float(local.mean()), _LEAST_DISTANCE)),
    }
    pairs = _in_units(spectral, local, learned)
    # A class's own scatter, to the power by which it is believed, is what its limit is told in.
    own = np.maximum(pairs.mean(axis=1, keepdims=True), _LEAST_SCATTER)
    relative = pairs / own**_SCATTER_POWER
    reached = float(np.quantile(relative, _LIMIT_QUANTILE))
    believed = relative.size / (relative.size + _TYPICAL_PAIRS)
    limit = _LIMIT_MARGIN * (believed * reached + (1.0 - believed) * _TYPICAL_LIMIT)
    limit *= max(_TELLING_PX**2 / float(learned["pixels"]), 1.0) ** 0.125
    return {**learned, "limit": np.array(limit)}


def _within(
    observations: Sequence[Observation],
    statistics: npt.NDArray[np.float64],
    floors: Parameters,
    whitening: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """(sets, 6) squared distances between the quarters of each set, of spectra and statistics."""
    white = statistics[:, 1:] @ whitening.T
    local = np.stack([np.square(white[:, i] - white[:, j]).sum(axis=1) for i, j in _PAIRS], axis=1)
    spectral = np.empty((len(observations), len(_PAIRS)))
    for row, observation in zip(spectral, observations, strict=True):
        series = _series(observation["quarters"], floors)
        row[:] = [np.square(np.abs(series[i] - series[j])).sum() for i, j in _PAIRS]
    return spectral, local


def _in_units(
    spectral: npt.NDArray[np.float64], local: npt.NDArray[np.float64], parameters: Parameters
) -> npt.NDArray[np.float64]:
    """Both distances as one, in units of the mean distance between quarters."""
    share = 1.0 / (1.0 + _LOCAL_SHARE)
    return (
        share * spectral / parameters["spectral_scatter"]
        + (1.0 - share) * local / parameters["local_scatter"]
    )


def _series(polar: FloatMap, parameters: Parameters) -> Complex:
    """(..., 3, R, A) densities to (..., 3 R, 16): weighted logarithms and coherence."""
    floor = np.float32(parameters["density_floor"])
    relief = polar[..., 0, :, :] + floor
    albedo = polar[..., 1, :, :] + np.float32(_ALBEDO_LEAK) * polar[..., 0, :, :] + floor
    channels = np.stack(
        [np.log(relief), np.log(albedo), polar[..., 2, :, :] / np.sqrt(relief * albedo)], axis=-3
    )
    # The bins of a radius do not depend on the segments but for the last: the grid is geometric.
    bins = np.minimum(np.geomspace(2.0, 0.98 * 64.0, RADII), _CAP_BINS)
    weights = np.outer(_CHANNEL_WEIGHTS, bins)
    channels *= np.sqrt(weights / weights.sum()).astype(np.float32)[..., None]
    return harmonics(channels.reshape(*polar.shape[:-3], _SERIES, polar.shape[-1]))


def _statistics(observation: Observation, parameters: Parameters) -> npt.NDArray[np.float64]:
    measured = LocalStatistics(
        observation["moments"], observation["energies"], observation["headings"]
    )
    leaks = _ALBEDO_LEAK * np.array(_ALBEDO_GAINS[: measured.levels])
    return statistics_vector(
        measured, parameters["relief_floors"], parameters["albedo_floors"], leaks
    )


def _signature(observation: Observation, parameters: Parameters) -> FloatMap:
    """Series, whitened statistics, heading, and a last number: (2 * 3 R * 16 + d + 73,) float32.

    Series and statistics are scaled so that their squared Euclidean distance is in units of the
    distance between quarters of one surface. The last number is, of a training set, the room its
    class is given, and of a test what its distances are divided by.
    """
    share = 1.0 / (1.0 + _LOCAL_SHARE)
    series = _series(observation["polar"], parameters)
    series *= np.float32(np.sqrt(share / parameters["spectral_scatter"]))
    statistics = _statistics(observation, parameters)
    white = statistics[0] @ parameters["whitening"].T
    white *= np.sqrt((1.0 - share) / parameters["local_scatter"])
    if "quarters" in observation:
        within = _within([observation], statistics[None], parameters, parameters["whitening"])
        mean = float(_in_units(*within, parameters).mean())
        last = max(mean, _LEAST_SCATTER) ** _SCATTER_POWER
    else:
        # Scatter goes with one over the area: a smaller frame lies further from its own class.
        last = max(0.5 + 0.5 * float(parameters["pixels"] / observation["pixels"]), 1.0)
    heading = heading_numbers(observation["headings"], parameters["heading_variances"])
    return np.concatenate(
        [series.ravel().view(np.float32), white.astype(np.float32), heading, [np.float32(last)]]
    )


def _references(observation: Observation, parameters: Parameters) -> FloatMap:
    """The signature of a set, and those it would have under turned lights where they differ."""
    own = _signature(observation, parameters)
    signatures = [own]
    for index in itertools.count():
        names = ("polar", "curl_density", "moments", "energies", "headings", "pixels")
        if f"turned_{index}_polar" not in observation:
            return np.stack(signatures)
        turned = _signature(
            {name: observation[f"turned_{index}_{name}"] for name in names}, parameters
        )
        turned[_HEADING], turned[-1] = own[_HEADING], own[-1]
        if np.square(turned - own).sum() > _WORTH_KEEPING:
            signatures.append(turned)
    raise AssertionError


def _compare(test: FloatMap, references: FloatMap, _: Parameters) -> Comparison:
    found = least_error(_series_of(test[None])[0], _series_of(references))
    local = np.square(references[:, STATISTICS] - test[STATISTICS])
    total = found.errors + local.sum(axis=1, dtype=np.float64)
    total /= test[-1]
    headings = heading_scores(test[_HEADING], references[:, _HEADING], found.shifts_deg)
    # The moments of a smaller frame scatter more.
    headings /= np.sqrt(test[-1])
    headings[found.sharpness < _DIRECTIONAL] = 0.0
    return Comparison(total, found.shifts_deg, found.sharpness, headings)


def _series_of(signatures: FloatMap) -> Complex:
    series: Complex = np.ascontiguousarray(signatures[:, :_SERIES_FLOATS]).view(np.complex64)
    return series.reshape(len(signatures), _SERIES, HARMONICS)


def _invariants(signatures: FloatMap) -> FloatMap:
    norms = shift_invariant_norms(_series_of(signatures))
    return np.concatenate([norms, signatures[:, STATISTICS], signatures[:, -1:]], axis=1)


def _without_heading(signatures: FloatMap) -> FloatMap:
    without = signatures.copy()
    without[:, _HEADING] = 0.0
    return without


def _limits(
    labels: Sequence[str], sets: Sequence[int], signatures: FloatMap, parameters: Parameters
) -> dict[str, float]:
    """For each class the limit, further out where its own sets lie further from each other."""
    members: dict[str, list[int]] = {}
    for index, label in enumerate(labels):
        members.setdefault(label, []).append(index)
    limits = {}
    for label, indices in members.items():
        own = signatures[indices]
        own_sets = np.array(sets)[indices]
        limit = float(parameters["limit"]) * float(own[:, -1].mean())
        for left_out in np.unique(own_sets)[:_MAX_LEFT_OUT]:
            others = own[own_sets != left_out]
            if len(others):
                asked = own[int(np.argmax(own_sets == left_out))].copy()
                asked[-1] = 1.0
                nearest = float(_compare(asked, others, parameters).distances.min())
                limit = max(limit, _LIMIT_MARGIN * nearest)
        limits[label] = limit
    return limits


JOINT = Classifier(
    name="joint",
    observe=_observe,
    observe_training=_observe_training,
    learn=_learn,
    signature=_signature,
    references=_references,
    compare=_compare,
    invariants=_invariants,
    without_heading=_without_heading,
    limits=_limits,
)
