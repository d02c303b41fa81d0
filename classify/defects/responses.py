"""Responses to spots and lines, on the grid of cells."""

from collections.abc import Iterator

import cv2
import numpy as np

from classify.surface.estimate import FloatMap

from .fields import COARSEST, HALF_CELL, resized
from .lines import LINE_DIRECTIONS, line_responses

SPOT_LEVELS = 5
"""Octaves of spots; a pixel of the coarsest covers `COARSEST` pixels at half resolution."""
RELIEF_LINES = ((0, 9), (1, 9), (1, 21))
ALBEDO_LINES = ((1, 9), (1, 21))
"""Octave and length in its pixels of the lines: 18, 36 and 84 px of the frame, two or four wide.

Half a step of the directions moves the ends of a line of nine pixels by half a pixel.
"""
RELIEF_RESPONSES, ALBEDO_RESPONSES = (
    SPOT_LEVELS + len(lines) * LINE_DIRECTIONS for lines in (RELIEF_LINES, ALBEDO_LINES)
)
"""Responses to spots and lines."""
assert 2 ** (SPOT_LEVELS - 1) == COARSEST


def pyramid(field: FloatMap) -> list[FloatMap]:
    """The field low-passed and sampled at `SPOT_LEVELS` octaves."""
    levels = [field]
    for _ in range(SPOT_LEVELS - 1):
        # Not pyrDown: its pixels are not in the middle of those that they stand for.
        blurred = np.asarray(cv2.GaussianBlur(levels[-1], (3, 3), 0), np.float32)
        rows, columns = blurred.shape
        levels.append(resized(blurred, rows // 2, columns // 2))
    return levels


def spot_and_line_responses(
    levels: list[FloatMap], lines: tuple[tuple[int, int], ...], orientation_deg: float
) -> Iterator[FloatMap]:
    """Absolute responses of one field on the grid of cells.

    The spots of every octave come first, then `lines` of given octaves and lengths in every
    direction.
    """
    rows, columns = (side // HALF_CELL for side in levels[0].shape)
    for number, level in enumerate(levels):
        response = np.abs(level)
        if HALF_CELL >> number > 1:
            yield _cell_maximum(response, HALF_CELL >> number)
        else:
            yield resized(response, rows, columns)
    for number, pixels in lines:
        yield from line_responses(levels[number], HALF_CELL >> number, pixels, orientation_deg)


def _cell_maximum(response: FloatMap, pixels: int) -> FloatMap:
    """Largest response of every square of `pixels` x `pixels`."""
    highest = cv2.dilate(response, np.ones((pixels, pixels), np.uint8), anchor=(0, 0))
    # With its anchor at the first pixel, a square reaches to the right and down.
    return np.ascontiguousarray(highest[::pixels, ::pixels])
