"""Detectors on one photograph or the albedo alone, compared with the defect map.

Both describe every place of a good part by a few features with one Gaussian distribution, score
the cells of the defect map, and get their limit by its rule.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from classify.defects.defect_map import CELL_PX
from classify.defects.departures import MomentSums, moment_sums, unlike_halves
from classify.defects.learning import common_limit, tile_maxima
from classify.surface.estimate import FloatMap

from .parts import CONDITIONS, Part

Features = Callable[[Part, float], FloatMap]
"""(H, W, d) features of a part whose texture is at an orientation, in degrees."""

# Side of the windows of local mean and deviation, px. With one window of 9, 17 or 33 the AUROC of
# pixels on eight textures fell by 0.01 to 0.06.
_WINDOWS_PX = (9, 25)
# Standard deviations of the Gaussian derivatives, px. With finer or coarser scales, or half or
# twice the smoothing below, the AUROC of stained pixels on these textures fell by 0.00 to 0.03.
_SCALES_PX = (2.0, 4.0, 8.0)
# Pixels between places: the finest scale of the derivatives.
_STEP_PX = 2
# Gaussian mean of the scores, px, as in PaDiM (Defard et al. 2021).
_SMOOTHING_PX = 4.0
# Share of each variance that is added to it, as in the defect map.
_RIDGE = 0.01
_FILL_PX = 3.0


@dataclass(frozen=True, eq=False)
class GaussianDetector:
    """One Gaussian of the features of good parts.

    Attributes
    ----------
    mean, whitening
        (d,) and (d, d): the score of features x is the length of (x - mean) @ whitening, smoothed,
        in units of the limit.
    """

    features: Features
    mean: npt.NDArray[np.float64]
    whitening: npt.NDArray[np.float64]

    @classmethod
    def learn(
        cls,
        features: Features,
        parts: Sequence[Part],
        orientations_deg: Sequence[float],
        false_alarm_rate: float,
    ) -> GaussianDetector:
        """Learn from good parts; the limit follows from the scores by unlike halves of them."""
        seen = [features(part, angle) for part, angle in zip(parts, orientations_deg, strict=True)]
        sums = [moment_sums(each.reshape(-1, each.shape[-1])) for each in seen]
        halves = unlike_halves(sums)
        maxima = []
        for half, others in zip(halves, halves[::-1], strict=True):
            detector = cls(features, *_gaussian([sums[index] for index in others]))
            for index in half:
                score = detector._score(seen[index])
                maxima.append(tile_maxima(score, np.ones(score.shape, np.bool_)))
        limit = common_limit(np.array(maxima), false_alarm_rate)
        mean, whitening = _gaussian(sums)
        return cls(features, mean, whitening / limit)

    def score(self, part: Part, orientation_deg: float) -> FloatMap:
        """Scores of the cells of a part; 1.0 is the limit."""
        return self._score(self.features(part, orientation_deg))

    def _score(self, features: FloatMap) -> FloatMap:
        offset = (features - np.float32(self.mean)) @ np.float32(self.whitening)
        square = np.einsum("hwd,hwd->hw", offset, offset)
        step_px = CONDITIONS.size_px // len(square)
        sigma = _SMOOTHING_PX / step_px
        square = cv2.GaussianBlur(square, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
        rows, cols = (side * step_px // CELL_PX for side in square.shape)
        return np.asarray(np.sqrt(cv2.resize(square, (cols, rows), interpolation=cv2.INTER_AREA)))


def one_photograph(part: Part, orientation_deg: float) -> FloatMap:
    """Local mean and deviation in windows of two sizes, under the first light.

    Means over square windows have no orientation, and shading cannot be aligned: the light does
    not rotate with the part.
    """
    del orientation_deg
    image = part.images.images[0].astype(np.float32)
    if part.images.ambient is not None:
        image -= part.images.ambient
    image /= image.mean()
    features = []
    for window in _WINDOWS_PX:
        mean = _mean(image, window)
        deviation = np.sqrt(np.maximum(_mean(image * image, window) - mean * mean, 0.0))
        features += [mean, deviation]
    return np.stack([each[::_STEP_PX, ::_STEP_PX] for each in features], axis=-1)


def albedo_filters(part: Part, orientation_deg: float) -> FloatMap:
    """Gaussian derivatives of order 0 to 2 of the log albedo, in the frame of the texture.

    At three scales. A derivative along the orientation is that of the image rotated back.
    """
    valid = part.surface.valid.astype(np.float32)
    log = np.log(np.maximum(part.surface.albedo, np.float32(1e-3))) * valid
    around = cv2.GaussianBlur(valid, (0, 0), _FILL_PX) + np.float32(1e-6)
    log = np.where(valid > 0, log, cv2.GaussianBlur(log, (0, 0), _FILL_PX) / around)
    log = np.asarray(log - log.mean(), np.float32)
    c, s = math.cos(math.radians(orientation_deg)), math.sin(math.radians(orientation_deg))
    features = []
    for scale in _SCALES_PX:
        blurred = cv2.GaussianBlur(log, (0, 0), scale, borderType=cv2.BORDER_REFLECT)
        level = np.asarray(blurred, np.float32)
        x, y = _derivatives(level, scale)
        (xx, xy), (_, yy) = _derivatives(x, scale), _derivatives(y, scale)
        features += [
            level, c * x + s * y, c * y - s * x, c * c * xx + 2 * c * s * xy + s * s * yy,
            c * s * (yy - xx) + (c * c - s * s) * xy, s * s * xx - 2 * c * s * xy + c * c * yy,
        ]  # fmt: skip
    return np.stack([each[::_STEP_PX, ::_STEP_PX] for each in features], axis=-1)


def _mean(image: FloatMap, window: int) -> FloatMap:
    blurred = cv2.blur(image, (window, window), borderType=cv2.BORDER_REFLECT)
    return np.asarray(blurred, np.float32)


def _derivatives(image: FloatMap, scale: float) -> tuple[FloatMap, FloatMap]:
    """Derivatives by x and y (up), times the scale."""
    x = cv2.Sobel(image, cv2.CV_32F, 1, 0, scale=scale / 8.0)
    y = cv2.Sobel(image, cv2.CV_32F, 0, 1, scale=-scale / 8.0)
    return np.asarray(x, np.float32), np.asarray(y, np.float32)


def _gaussian(
    sums: Sequence[MomentSums],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Mean and whitening of the places of all parts."""
    moments = np.sum(sums, axis=0)
    moments = moments / moments[0, 0]
    mean = moments[0, 1:]
    covariance = moments[1:, 1:] - np.outer(mean, mean)
    covariance += _RIDGE * np.diag(np.diag(covariance)) + 1e-9 * np.eye(len(mean))
    values, vectors = np.linalg.eigh(covariance)
    return mean, vectors / np.sqrt(values)
