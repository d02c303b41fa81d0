"""Samples of a frame that prefer no side and no direction."""

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

IndexArray = npt.NDArray[np.intp]


@lru_cache(maxsize=32)
def sample_pixels(shape: tuple[int, int], most: int, margin: int = 0) -> IndexArray:
    """Flat indices of about `most` pixels, evenly spread, without `margin` px at the sides.

    The grid is symmetric about the middle: a rotated or mirrored frame has the same samples.
    """
    rows, columns = (max(0, side - 2 * margin) for side in shape)
    step = max(1, math.ceil(math.sqrt(rows * columns / most)))
    grid = (margin + symmetric_samples(rows, step)), (margin + symmetric_samples(columns, step))
    return (grid[0][:, None] * shape[1] + grid[1]).ravel()


@lru_cache(maxsize=32)
def symmetric_samples(size: int, step: int) -> IndexArray:
    """Indices below `size` at distances of `step`, symmetric about (size - 1) / 2."""
    middle = (size - 1) // 2
    first = middle if size % 2 else min(middle, max(0, middle - (step - 1) // 2))
    lower = np.arange(first, -1, -step)
    return np.union1d(lower, size - 1 - lower)
