"""Whether the images of one set overlie each other, by the redundancy of their lights.

On a matt surface the other images predict image k. If it is shifted by d, it differs from their
prediction by d . grad(i_k), besides a factor of its light.
"""

import cv2
import numpy as np

from classify.base.arrays import Array, BoolArray, FloatMap
from classify.lighting import Lighting
from classify.shadow_rule import MAYBE_SHADOW

# Larger images are reduced so that their shorter side has at most twice this, to save time.
_SIDE_PX = 512
_SIGMA_PX = 2.0  # of the Gaussian before the gradient
_BORDER_PX = 7
# A shift explains at least this share of the misfit, and is at least this long in reduced images.
# One of 1331 picks of four to eight photographs in tests/data reaches both, and three in four do if
# one photograph is shifted by 3 px (test_registration.py).
_MIN_EXPLAINED, _MIN_SHIFT_PX = 0.6, 1.5
# An image is predicted if the others contain at least this share of it.
_MIN_REDUNDANCY = 0.03


def shift_of_one_image(
    images: Array,
    ambient: Array,
    lighting: Lighting,
    full_scale: float,
    mask: BoolArray | None = None,
) -> float | None:
    """Length in px of the shift of one of the images (N, H, W); None if no shift explains them."""
    rows, columns = images.shape[1:]
    step = max(1, min(rows, columns) // _SIDE_PX)
    size = (max(1, columns // step), max(1, rows // step))

    def reduced(image: Array) -> FloatMap:
        plane = cv2.resize(np.asarray(image, np.float32), size, interpolation=cv2.INTER_AREA)
        return np.asarray(cv2.GaussianBlur(plane, (0, 0), _SIGMA_PX), np.float32)

    values = np.stack([reduced(image) for image in images]) - reduced(ambient)
    values /= lighting.intensities[:, None, None].astype(np.float32)
    excluded = images.max(axis=0) >= full_scale
    if mask is not None:
        excluded |= ~mask
    usable = (reduced(excluded) == 0.0) & (values.min(axis=0) > MAYBE_SHADOW * values.max(axis=0))
    inside = np.zeros_like(usable)
    inside[_BORDER_PX:-_BORDER_PX, _BORDER_PX:-_BORDER_PX] = True
    usable &= inside
    directions = lighting.directions
    redundancy = np.eye(len(directions)) - directions @ np.linalg.pinv(directions)
    lit = values[:, usable]
    explained, shift_px = 0.0, 0.0
    for k, value in enumerate(values):
        if redundancy[k, k] < _MIN_REDUNDANCY:
            continue
        misfit = redundancy[k] @ lit / redundancy[k, k]
        slopes = (cv2.Sobel(value, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
        terms = np.stack([lit[k], *(slope[usable] for slope in slopes)]).astype(np.float64)
        moments, products = terms @ terms.T, terms @ misfit
        # Without the factor of the light, which is no shift.
        by_light = products[0] ** 2 / max(moments[0, 0], 1e-12)
        solution = np.linalg.pinv(moments, hermitian=True) @ products
        rest = max(float(misfit @ misfit) - by_light, 1e-12)
        share = float(products @ solution - by_light) / rest
        if share > explained:
            explained, shift_px = share, float(np.hypot(*solution[1:]))
    is_clear = explained > _MIN_EXPLAINED and shift_px > _MIN_SHIFT_PX
    return step * shift_px if is_clear else None
