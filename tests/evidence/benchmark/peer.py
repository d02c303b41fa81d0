"""A peer from PyPI: local binary patterns of scikit-image, without orientation."""

import numpy as np
from skimage.feature import local_binary_pattern

from classify.base.arrays import Array, FloatMap, Floats
from classify.texture.fields import TextureFields

_POINTS, _RADIUS_PX = 8, 1


def patterns(fields: TextureFields, taught: Floats) -> int:
    """Index of the taught histograms (n, bins) that is nearest to that of the fields."""
    histogram = _histogram(fields)
    chi_squared = np.square(taught - histogram) / np.maximum(taught + histogram, 1e-12)
    return int(np.argmin(chi_squared.sum(axis=1)))


def training_patterns(fields: TextureFields, count: int) -> Floats:
    """`count` histograms; their values do not change the time of a match."""
    return np.repeat(_histogram(fields)[None], count, axis=0)


def _histogram(fields: TextureFields) -> Floats:
    bins = np.arange(_POINTS + 3)
    planes = (fields.albedo, np.hypot(fields.p, fields.q))
    counts = [
        np.histogram(local_binary_pattern(_eight_bit(plane), _POINTS, _RADIUS_PX, "uniform"), bins)
        for plane in planes
    ]
    return np.concatenate([count / count.sum() for count, _ in counts])


def _eight_bit(plane: FloatMap) -> Array:
    low, high = plane.min(), plane.max()
    return ((plane - low) * (255.0 / (high - low))).astype(np.uint8)
