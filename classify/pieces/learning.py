"""Learn a `PieceModel` from good parts, each scored by the windows of the others."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from classify.base.errors import InputError
from classify.confidence import tolerance_factor
from classify.surface.estimate import FloatMap, SurfaceEstimate
from classify.texture.fields import texture_fields

from .features import energy_floors, window_features, window_moments
from .look_alikes import LookAlikes
from .piece_model import SIZES, VIEWS, PieceModel
from .whole_part import (
    Floats,
    handedness_measure,
    octave_levels,
    pseudo_scalars,
    scale_measure,
)

LEAST_PARTS = 3
SCALE_STEP = 0.05
"""Change of scale from which the direction of a change of scale is learned."""

# Shares of good parts within the limit of a view by its kind, and of an octave, of which a part has
# many. A piece that lies otherwise is far beyond its limit. The good parts that are rejected are
# those of `python -m tests.evidence.wrong_passes`.
_COVERAGES = {"window": 0.999, "seam": 0.9999}
_OCTAVE_COVERAGE = 0.999
# Prior of the standard deviation of the logarithm of the highest scores of good parts, and the
# number of parts that it counts as: it was 0.05 to 0.25 on the textures of that command.
_PRIOR_SPREAD, _PRIOR_FREEDOM = 0.12, 4
# Least departure of the root mean square of an octave that exceeds its limit.
_LEAST_OCTAVE = math.log(1.05)


@dataclass(frozen=True, eq=False)
class GoodPart:
    """What is learned from one good part.

    Attributes
    ----------
    moments
        Its `band_moments`.
    orientation_deg
        Orientation of its texture; None counts as 0.
    rings
        Its `ring_levels`.
    """

    moments: FloatMap
    orientation_deg: float | None
    rings: Floats


def learn_pieces(parts: Sequence[GoodPart], scale_direction: Floats) -> PieceModel:
    """Learn what good parts of one texture look like in pieces, and as a whole.

    Parameters
    ----------
    parts
        Good parts, three or more of one size.
    scale_direction
        Change of the rings by a scale of e, from `scaled_surface`.

    Raises
    ------
    InputError
        For too few parts, or parts of different sizes.
    """
    if len(parts) < LEAST_PARTS:
        raise InputError(f"{len(parts)} good parts; give {LEAST_PARTS} or more")
    if len({part.moments.shape for part in parts}) > 1:
        raise InputError("the good parts differ in the size of their frames; capture them alike")
    floors = energy_floors(np.mean([part.moments.mean(axis=(0, 1)) for part in parts], axis=0))
    features = {
        size: [
            window_features(window_moments(part.moments, size), floors, part.orientation_deg or 0.0)
            for part in parts
        ]
        for size in SIZES
    }
    views = {}
    for name, size, columns in VIEWS:
        found, scores = LookAlikes.of(features[size], columns)
        highest = 0.5 * np.log([max(float(each.max()), 1e-9) for each in scores])
        factor = tolerance_factor(len(parts), _COVERAGES[name.partition("_")[0]])
        limit = highest.mean() + factor * _spread(highest)
        views[name] = replace(found, spreads=found.spreads * np.float32(math.exp(2.0 * limit)))
    factor = tolerance_factor(len(parts), _OCTAVE_COVERAGE)
    levels = np.array([octave_levels(part.moments) for part in parts])
    scale, scales = scale_measure(np.array([part.rings for part in parts]), scale_direction)
    handedness, hands = handedness_measure(
        np.array([pseudo_scalars(part.moments) for part in parts])
    )
    least = hands.mean() - tolerance_factor(len(parts)) * hands.std(ddof=1)
    return PieceModel(
        floors,
        views,
        levels.mean(axis=0),
        np.maximum(factor * levels.std(axis=0, ddof=1), _LEAST_OCTAVE),
        scale,
        handedness if least > 0.0 else None,
        float(scales.std(ddof=1)),
    )


def _spread(logarithms: Floats) -> float:
    """Standard deviation of values, with its prior."""
    freedom = len(logarithms) - 1
    squares = _PRIOR_FREEDOM * _PRIOR_SPREAD**2 + freedom * logarithms.var(ddof=1)
    return math.sqrt(squares / (_PRIOR_FREEDOM + freedom))


def scaled_surface(surface: SurfaceEstimate, scale: float) -> SurfaceEstimate:
    """A part whose texture is larger by `scale`: its middle for a larger one, without gaps."""
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
