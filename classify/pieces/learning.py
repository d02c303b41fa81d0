"""Learn a `PieceModel` from good parts; limits follow from scores by cross-validation."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from classify.base.arrays import Floats
from classify.base.errors import InputError
from classify.confidence import tolerance_factor
from classify.surface.estimate import FloatMap, SurfaceEstimate
from classify.texture.fields import texture_fields

from .features import coarser, energy_floors, window_features, window_moments
from .look_alikes import LookAlikes
from .piece_model import (
    SIZES,
    VIEWS,
    PieceModel,
    handedness_measure,
    octave_levels,
    pseudo_scalars,
    scale_measure,
)
from .spots import DEPARTURES, SpotModel, left_out_models, spot_values, subsampled

_MIN_PARTS = 3
SCALE_STEP = 0.05
"""Change of scale from which the direction of a change of scale is learned."""

# Coverage of the tolerance limits of windows, spots and seams, and of an octave. A misplaced piece
# is far beyond its limit; `python -m tests.evidence.wrong_passes` counts rejected good parts. With
# 0.999 for spots 0 instead of 4 of 40 good parts of bark are rejected, whose highest scores have
# the long tail of a maximum (Gumbel 1958). But 5 of 24 holes of 40 px in tiles, which only spots
# detect, then pass, and so do dents in bricks. With 0.99 for polished and washed out spots 2 of 450
# good parts of twelve materials exceed their limits, with 0.997 none.
_COVERAGES = {
    "window": 0.999, "seam": 0.9999,
    "missing": 0.99, "polished": 0.997, "washed": 0.997, "stain": 0.99, "dent": 0.99,
}  # fmt: skip
_OCTAVE_COVERAGE = 0.999
# A texture has a direction if this share of its good parts, rotated by 90 degrees, has a window
# farther from the good ones than any window of a left-out part.
_MIN_DIRECTEDNESS = 0.9
# Prior of the standard deviation of the logarithm of the highest scores of good parts, and the
# number of parts that it counts as. The standard deviation is 0.05 to 0.25 on the textures of
# `python -m tests.evidence.wrong_passes`.
_PRIOR_SPREAD, _PRIOR_FREEDOM = 0.12, 4
# Largest number of training spots, and number of folds of the cross-validation.
_MAX_SPOTS, _FOLDS = 25_000, 5
# Smallest limit on the departure of the rms of an octave.
_MIN_OCTAVE_LIMIT = math.log(1.05)


@dataclass(frozen=True, eq=False)
class GoodPart:
    """A good part, as `learn_pieces` needs it."""

    moments: FloatMap  # `band_moments`
    orientation_deg: float | None  # None counts as 0
    rings: Floats  # `ring_means`


def learn_pieces(parts: Sequence[GoodPart], scale_direction: Floats) -> PieceModel:
    """Learn a `PieceModel`; `scale_direction` is the change of the rings by a scale of e."""
    if len(parts) < _MIN_PARTS:
        raise InputError(f"{len(parts)} good parts; give {_MIN_PARTS} or more")
    if len({part.moments.shape for part in parts}) > 1:
        raise InputError("the good parts differ in the size of their frames; capture them alike")
    floors = energy_floors(np.mean([part.moments.mean(axis=(0, 1)) for part in parts], axis=0))
    coarses = [coarser(part.moments) for part in parts]
    orientations = [part.orientation_deg or 0.0 for part in parts]
    features = {
        (size, angle): [
            window_features(window_moments(coarse, size), floors, orientation + angle)
            for coarse, orientation in zip(coarses, orientations, strict=True)
        ]
        for size in SIZES
        for angle in (0.0, 90.0)
    }
    views = {}
    has_direction = np.zeros(len(parts), np.bool_)
    for name, size, columns in VIEWS:
        look_alikes, scores = LookAlikes.of(features[size, 0.0], columns)
        kind = name.partition("_")[0]
        highest = np.array([part_scores.max() for part_scores in scores])
        if kind == "seam":
            rotated = (look_alikes.scores(part).max() for part in features[size, 90.0])
            has_direction |= [score > highest.max() for score in rotated]
        limit = _limit(np.sqrt(highest), kind)
        views[name] = replace(look_alikes, spreads=look_alikes.spreads * np.float32(limit**2))
    factor = tolerance_factor(len(parts), _OCTAVE_COVERAGE)
    levels = np.array([octave_levels(coarse) for coarse in coarses])
    scale, left_out_scales = scale_measure(
        np.array([part.rings for part in parts]), scale_direction
    )
    pseudo_scalars_of_parts = np.array([pseudo_scalars(coarse) for coarse in coarses])
    handedness, left_out = handedness_measure(pseudo_scalars_of_parts)
    lower_limit = left_out.mean() - tolerance_factor(len(parts)) * left_out.std(ddof=1)
    return PieceModel(
        floors,
        views,
        _spot_model(parts, floors),
        levels.mean(axis=0),
        np.maximum(factor * levels.std(axis=0, ddof=1), _MIN_OCTAVE_LIMIT),
        scale,
        handedness if lower_limit > 0.0 else None,
        bool(has_direction.mean() >= _MIN_DIRECTEDNESS),
        float(left_out_scales.std(ddof=1)),
    )


def _spot_model(parts: Sequence[GoodPart], floors: FloatMap) -> SpotModel:
    def values(part: GoodPart) -> FloatMap:
        return spot_values(part.moments, floors, part.orientation_deg or 0.0)

    samples = [subsampled(values(part), _MAX_SPOTS // len(parts)) for part in parts]
    folds = min(len(parts), _FOLDS)
    models = left_out_models(samples, folds)
    highest = np.array([
        models[n % folds].scores(values(part)).max(axis=(1, 2)) for n, part in enumerate(parts)
    ])  # fmt: skip
    limits = np.array([_limit(*pair) for pair in zip(highest.T, DEPARTURES, strict=True)])
    return SpotModel.of(np.hstack(samples)).with_limits(limits)


def _limit(highest: npt.NDArray[Any], kind: str) -> float:
    """Tolerance limit of a score from the highest ones of left-out good parts."""
    logs = np.log(np.maximum(highest.astype(np.float64), 1e-9))
    return math.exp(logs.mean() + tolerance_factor(len(logs), _COVERAGES[kind]) * _spread(logs))


def _spread(logarithms: Floats) -> float:
    """Standard deviation, pooled with its prior."""
    freedom = len(logarithms) - 1
    squares = _PRIOR_FREEDOM * _PRIOR_SPREAD**2 + freedom * logarithms.var(ddof=1)
    return math.sqrt(squares / (_PRIOR_FREEDOM + freedom))


def scaled_surface(surface: SurfaceEstimate, scale: float) -> SurfaceEstimate:
    """A part whose texture is larger by `scale`, cut to the frame, with all pixels valid."""
    fields = texture_fields(surface)
    rows, columns = surface.shape
    height, width = round(scale * rows), round(scale * columns)
    top, left = max(height - rows, 0) // 2, max(width - columns, 0) // 2
    p, q, albedo = (
        np.ascontiguousarray(
            cv2.resize(plane, (width, height), interpolation=cv2.INTER_CUBIC)[
                top : top + rows, left : left + columns
            ],
            np.float32,
        )
        for plane in (fields.p, fields.q, fields.albedo)
    )
    return replace(surface, p=p, q=q, albedo=albedo, valid=np.ones(p.shape, np.bool_), images=None)
