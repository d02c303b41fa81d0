"""Check that the placements of a calibration target differ."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from classify.base.arrays import Array
from classify.base.errors import InputError
from classify.lights.flat_field import TERMS, FlatField, powers

from .plate_blocks import PlateBlocks

# Correlation of the grain of two placements of one sheet, as rendered in test_plate.py without
# dust: 0.09 at most if it was rotated between them; if not, 0.73 and more for a grain of 0.5 %, and
# lost in the noise for an even sheet. The pattern of the sensor does not rotate, but is weaker.
_ALIKE = 0.7


def check_placements_differ(images: Sequence[Array]) -> None:
    """Refuse placements with the same light images: their errors are the same."""
    for (first, one), (second, other) in combinations(enumerate(images, start=1), 2):
        if np.array_equal(one, other):
            raise InputError(
                f"placements {first} and {second} have the same light images; rotate or move the "
                "target between them, or give them once"
            )


def are_moved(blocks: PlateBlocks, flat_field: FlatField) -> bool:
    """Whether the sheet was rotated or moved between any two placements, by its grain and dust."""
    y, x = powers(blocks.y, TERMS), powers(blocks.x, TERMS)
    uneven = blocks.logs.mean(axis=1) - y @ flat_field.coefficients.mean(axis=0) @ x.T
    # Subtract the mean of the four neighbours, and with it a smooth bias of the polynomial.
    grain, usable = uneven[:, 1:-1, 1:-1].copy(), blocks.usable[:, 1:-1, 1:-1].copy()
    for rows, columns in ((0, 1), (2, 1), (1, 0), (1, 2)):
        near = np.s_[:, rows : rows + grain.shape[1], columns : columns + grain.shape[2]]
        grain -= 0.25 * uneven[near]
        usable &= blocks.usable[near]
    for first, other in combinations(range(len(grain)), 2):
        one, two = (grain[placement][usable[first] & usable[other]] for placement in (first, other))
        if one @ two <= _ALIKE * np.linalg.norm(one) * np.linalg.norm(two):
            return True
    return False
