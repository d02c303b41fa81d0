"""A place of the frame that looks alike on all good parts, as a printed logo does."""

import cv2
import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from classify.surface.estimate import FloatMap, SurfaceEstimate

from .cell_statistics import window_statistics
from .defect_map import CELL_PX
from .fields import gaussian_mean, part_fields

# Cells over which a change is light or form, no mark: standard deviation of the Gaussian.
_SLOW_CELLS = 6.0
# Probability that any place of parts without a mark is found.
_CHANCE = 1e-3
# Standard deviations of a normal distribution in its median absolute deviation.
_PER_MEDIAN = 1.0 / float(ndtri(0.75))

Box = tuple[int, int, int, int]


class FixedMarks:
    """Looks for a mark that all good parts have at one place of the frame.

    The parts of a texture are pieces from anywhere, so the local statistics of one place are
    independent of each other. Those of each part are replaced by their normal scores (van der
    Waerden 1952), and the sum over n parts, divided by sqrt(n), has a normal distribution. It is
    compared with the whole frame, because captures of one and the same part are alike everywhere.
    """

    def __init__(self) -> None:
        self._parts = 0
        self._sums: FloatMap | None = None
        self._valid: npt.NDArray[np.bool_] | None = None

    def add(self, surface: SurfaceEstimate) -> None:
        """Add a good part; all have one frame size."""
        fields = part_fields(surface)
        valid, share = fields.valid, fields.valid.astype(np.float32)
        around = np.maximum(gaussian_mean(share, _SLOW_CELLS), np.float32(1e-3))
        scores = []
        for values in np.moveaxis(window_statistics(fields.moments, 0.0), -1, 0):
            fast = values - gaussian_mean(values * share, _SLOW_CELLS) / around
            scores.append(_normal_scores(fast, valid))
        if self._sums is None or self._valid is None:
            self._sums, self._valid = np.zeros_like(scores), valid
        self._sums += scores
        self._valid = self._valid & valid
        self._parts += 1

    def found(self) -> Box | None:
        """X, y, width and height in px of the mark, without its surroundings; None without one."""
        if self._sums is None or self._valid is None:
            return None
        # At borders of the frame and of parts, windows are cut.
        inside = cv2.erode(
            self._valid.astype(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT,
            borderValue=0,
        ).astype(np.bool_)  # fmt: skip
        if not inside.any():
            return None
        sums: FloatMap = np.abs(self._sums) / np.sqrt(np.float32(self._parts))
        spread = np.maximum(_PER_MEDIAN * np.median(sums[:, inside], axis=1), np.float32(1.0))
        highest = np.where(inside, np.max(sums / spread[:, None, None], axis=0), 0.0)
        limit = -ndtri(0.5 * _CHANCE / (len(sums) * np.count_nonzero(inside)))
        if highest.max() <= limit:
            return None
        _, labels, boxes, _ = cv2.connectedComponentsWithStats(
            (highest > limit).astype(np.uint8), connectivity=8
        )
        label = labels.flat[int(np.argmax(highest))]
        left, top, width, height = (CELL_PX * int(side) for side in boxes[label][:4])
        return left, top, width, height


def _normal_scores(values: FloatMap, valid: npt.NDArray[np.bool_]) -> FloatMap:
    """Quantiles of the normal distribution at the ranks of the valid values; 0 for the others."""
    scores = np.zeros(values.shape, np.float32)
    count = np.count_nonzero(valid)
    ranks = np.empty(count)
    ranks[np.argsort(values[valid], kind="stable")] = (np.arange(count) + 0.5) / count
    scores[valid] = ndtri(ranks)
    return scores
