"""The default classifier: polar spectra at all orientations, and local statistics.

A signature is one vector of float32: Fourier series of the polar spectra, whitened statistics,
their changes by blur, the features of the heading, and a scatter factor. The factor of a reference
multiplies the limit of its class; that of a test divides the distances.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from classify.base.arrays import FloatMap, Floats, Indices
from classify.texture.blur import KNOTS_PX2, blur_penalty, min_over_blurs
from classify.texture.heading import HEADING_FLOATS, heading_features, heading_scores
from classify.texture.orientation import (
    HARMONICS,
    Complex,
    agreement_by_shift,
    least_error,
    shift_invariant_norms,
)
from classify.texture.statistics import LocalStatistics
from classify.texture.uniformity import Uniformity

from . import Classifier, Comparison, Parameters
from .joint_bounds import BLUR_BASIS, blur_coordinates, bounds
from .joint_features import (
    SERIES,
    JointObservation,
    JointTraining,
    blur_curve,
    combined_distances,
    local_unit,
    observe,
    observe_training,
    quarter_distances,
    spectral_series,
    spectral_unit,
    statistics_rows,
)
from .joint_learning import class_limits, learn, limit_factors, parameter_shapes, scatter_factor

# Least sharpness of an orientation that gets a heading; a less sharp one may be off by 90 degrees.
_MIN_SHARPNESS = 0.5
# Least squared distance of a reference under rotated lights from the set's own signature, in units
# of the distance between quarters. A nearer reference changes no match and is left out.
_MIN_SQUARED_DISTANCE = 0.1

_SERIES_FLOATS = 2 * SERIES * HARMONICS
_HEADING = slice(-1 - HEADING_FLOATS, -1)
_RINGS = slice(0, _SERIES_FLOATS, 2 * HARMONICS)  # the real part of harmonic 0


def ring_means(signature: FloatMap) -> Floats:
    """(SERIES,) means of the rings of the spectra in a signature: relief, albedo, coherence."""
    return signature[_RINGS].astype(np.float64)


def _signature(observation: JointObservation, parameters: Parameters) -> FloatMap:
    # Half of the scatter of a frame is inversely proportional to its area, so that smaller frames
    # are further from their class.
    ratio = float(parameters["pixels"] / float(observation.pixels))
    return _vector(observation, (), parameters, max(0.5 + 0.5 * ratio, 1.0))


def _references(training: JointTraining, parameters: Parameters) -> FloatMap:
    """Signatures of a training set: its own, then those under rotated lights."""
    statistics = statistics_rows(training.frame.statistics, parameters)
    distances = quarter_distances([training], statistics[None], parameters)
    factor = scatter_factor(combined_distances(*distances, parameters))
    own = _vector(training.frame, training.blurred, parameters, factor)
    compared = slice(_curve_slice(parameters).start)
    references = [own]
    for observation in training.rotated:
        rotated = _vector(observation, training.blurred, parameters, factor)
        rotated[_HEADING] = own[_HEADING]
        if np.square(rotated[compared] - own[compared]).sum() > _MIN_SQUARED_DISTANCE:
            references.append(rotated)
    return np.stack(references)


def _vector(
    observation: JointObservation,
    blurred: Sequence[LocalStatistics],
    parameters: Parameters,
    factor: float,
) -> FloatMap:
    """Assemble a signature: series, whitened statistics, changes by blur, heading and factor."""
    series = spectral_series(observation.polar, parameters)
    series *= np.float32(spectral_unit(parameters))
    statistics = statistics_rows(observation.statistics, parameters)
    whitened = statistics[0] @ parameters["whitening"].T
    whitened *= local_unit(parameters)
    heading = heading_features(observation.statistics.headings, parameters["heading_variances"])
    curve = blur_curve(observation, blurred, parameters)
    parts = (
        series.view(np.float32),
        whitened.astype(np.float32),
        curve,
        heading,
        np.float32(factor),
    )
    return np.concatenate([part.ravel() for part in parts])


def _compare(test: FloatMap, references: FloatMap, parameters: Parameters) -> Comparison:
    spectral = least_error(_series_of(test[None])[0], _series_of(references))
    own, others = _blur_features(test[None], parameters)[0], _blur_features(references, parameters)
    # Harmonic 0 and the statistics are compared at the best blur; blur does not change the other
    # harmonics or the shift.
    curve, curves = _curves(test[None], parameters)[0], _curves(references, parameters)
    penalty = blur_penalty(float(parameters["pixels"]))
    at_best_blur, variances = min_over_blurs(own, curve, others, curves, SERIES, penalty)
    ring_errors = np.square(others - own)[:, :SERIES].sum(axis=1, dtype=np.float64)
    total = np.maximum(spectral.errors - ring_errors, 0.0) + at_best_blur
    blurs_px = np.sign(variances) * np.sqrt(np.abs(variances))
    total /= test[-1]
    headings = heading_scores(test[_HEADING], references[:, _HEADING], spectral.shifts_deg)
    # The moments of a smaller frame scatter more.
    headings /= np.sqrt(test[-1])
    headings[spectral.sharpness < _MIN_SHARPNESS] = 0.0
    return Comparison(total, spectral.shifts_deg, spectral.sharpness, headings, blurs_px)


def _agreement(test: FloatMap, references: FloatMap) -> Floats:
    return agreement_by_shift(_series_of(test[None])[0], _series_of(references))


def _limits(
    labels: Sequence[str],
    sets: Sequence[int],
    references: FloatMap,
    parameters: Parameters,
    uniformity: Mapping[str, Uniformity],
) -> dict[str, float]:
    tests = references.copy()
    tests[:, -1] = 1.0
    invariants = _invariants(tests, parameters)

    def lower_bounds(index: int, others: Indices) -> Floats:
        return bounds(invariants[index], invariants[others], parameters)

    def nearest(index: int, others: Indices) -> float:
        return float(_compare(tests[index], references[others], parameters).distances.min())

    factors = limit_factors(labels, sets, references[:, -1], uniformity)
    single_set_limits = float(parameters["limit"]) * factors
    return class_limits(labels, sets, single_set_limits, lower_bounds, nearest)


def _series_of(signatures: FloatMap) -> Complex:
    series: Complex = np.ascontiguousarray(signatures[:, :_SERIES_FLOATS]).view(np.complex64)
    return series.reshape(len(signatures), SERIES, HARMONICS)


def _curve_slice(parameters: Parameters) -> slice:
    """Slice of the changes by blur in a signature."""
    return slice(_SERIES_FLOATS + len(parameters["whitening"]), _HEADING.start)


def _blur_features(signatures: FloatMap, parameters: Parameters) -> FloatMap:
    """(n, SERIES + d) features that blur changes: means of rings, then statistics."""
    statistics = signatures[:, _SERIES_FLOATS : _curve_slice(parameters).start]
    return np.concatenate([signatures[:, _RINGS], statistics], axis=1)


def _curves(signatures: FloatMap, parameters: Parameters) -> FloatMap:
    curves = signatures[:, _curve_slice(parameters)]
    return np.ascontiguousarray(curves.reshape(len(signatures), len(KNOTS_PX2), -1))


def _invariants(signatures: FloatMap, parameters: Parameters) -> FloatMap:
    features, curves = _blur_features(signatures, parameters), _curves(signatures, parameters)
    coordinates = blur_coordinates(features, curves, parameters[BLUR_BASIS])
    norms = shift_invariant_norms(_series_of(signatures))
    return np.concatenate([norms, features[:, SERIES:], coordinates, signatures[:, -1:]], axis=1)


def _without_heading(references: FloatMap) -> FloatMap:
    without = references.copy()
    without[:, _HEADING] = 0.0
    return without


JOINT = Classifier(
    name="joint",
    observe=observe,
    observe_training=observe_training,
    signature=_signature,
    references=_references,
    compare=_compare,
    learn=learn,
    parameter_shapes=parameter_shapes,
    unevenness=lambda training: training.unevenness,
    limits=_limits,
    has_invariants=True,
    invariants=_invariants,
    bounds=bounds,
    agreement=_agreement,
    without_heading=_without_heading,
)
