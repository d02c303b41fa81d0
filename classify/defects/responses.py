"""Responses to spots, lines and local statistics, on the grid of cells."""

from collections.abc import Iterator

import cv2
import numpy as np

from classify.surface.estimate import FloatMap

from .fields import COARSEST, HALF_CELL, gaussian_mean, resized
from .lines import LINE_DIRECTIONS, line_responses

SPOT_LEVELS = 5
"""Octaves of spots; a pixel of the coarsest covers `COARSEST` pixels at half resolution."""
RELIEF_LINES = ((0, 9), (1, 9), (1, 21))
ALBEDO_LINES = ((1, 9), (1, 21))
"""Octave and length in its pixels of the lines: 18, 36 and 84 px of the frame, two or four wide.

Half a step of the directions moves the ends of a line of nine pixels by half a pixel.
"""
TEXTURE_LEVELS = 4
"""Octaves of the local statistics."""
RELIEF_RESPONSES, ALBEDO_RESPONSES = (
    SPOT_LEVELS + len(lines) * LINE_DIRECTIONS for lines in (RELIEF_LINES, ALBEDO_LINES)
)
"""Responses to spots and lines."""
STATISTICS = 2 * 3 * TEXTURE_LEVELS
"""Local statistics of a cell."""

# Cells over which local statistics are averaged: standard deviation of the Gaussian.
_STATISTICS_CELLS = 1.5
# Energies of a white field of variance 1 are of order 1; this floor keeps logarithms finite.
_ENERGY_FLOOR = np.float32(1e-3)

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


def local_statistics(
    relief: list[FloatMap], albedo: list[FloatMap], weight: FloatMap, orientation_deg: float
) -> FloatMap:
    """(h, w, STATISTICS) float32 statistics of every cell in the frame of the texture.

    Per octave of relief and then of albedo: the logarithm of the energy, and its anisotropy as the
    cosine and sine of twice the direction.
    """
    rows, columns = (side // HALF_CELL for side in relief[0].shape)
    angle = np.radians(2.0 * orientation_deg)
    c, s = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    values = []
    around = gaussian_mean(resized(weight * weight, rows, columns), _STATISTICS_CELLS)
    around += np.float32(1e-3)
    for field in (relief, albedo):
        for level in field[:TEXTURE_LEVELS]:
            x = cv2.Sobel(level, cv2.CV_32F, 1, 0, scale=0.25)
            y = cv2.Sobel(level, cv2.CV_32F, 0, 1, scale=-0.25)
            xx, yy, xy = (
                gaussian_mean(resized(each, rows, columns), _STATISTICS_CELLS) / around
                for each in (x * x, y * y, x * y)
            )
            total, even, odd = xx + yy + 2 * _ENERGY_FLOOR, xx - yy, 2 * xy
            values += [np.log(total), (c * even + s * odd) / total, (c * odd - s * even) / total]
    return np.stack(values, axis=-1)
