"""Responses to spots, lines and local statistics, on the grid of cells."""

from collections.abc import Iterator

import cv2
import numpy as np

from classify.surface.estimate import FloatMap

from .fields import COARSEST, HALF_CELL, gaussian_mean, resized

SPOT_LEVELS = 5
"""Octaves of spots; a pixel of the coarsest covers `COARSEST` pixels at half resolution."""
LINE_LEVELS = 2
"""Octaves of the width of lines."""
LINE_DIRECTIONS = 12
"""Directions of lines over 180 degrees, in the frame of the texture."""
TEXTURE_LEVELS = 4
"""Octaves of the local statistics."""
RESPONSES = SPOT_LEVELS + LINE_LEVELS * LINE_DIRECTIONS
"""Responses to spots and lines of one field."""
STATISTICS = 2 * 3 * TEXTURE_LEVELS
"""Local statistics of a cell."""

# Pixels on a line filter. Half a step of its 15 degrees moves its ends by one pixel.
_LINE_PIXELS = 9
# Cells over which local statistics are averaged: standard deviation of the Gaussian.
_STATISTICS_CELLS = 2.0
# Energies of a white field of variance 1 are of order 1; this floor keeps logarithms finite.
_ENERGY_FLOOR = np.float32(1e-3)

assert 2 ** (SPOT_LEVELS - 1) == COARSEST


def pyramid(field: FloatMap) -> list[FloatMap]:
    """The field low-passed and sampled at `SPOT_LEVELS` octaves."""
    levels = [field]
    for _ in range(SPOT_LEVELS - 1):
        levels.append(np.asarray(cv2.pyrDown(levels[-1]), np.float32))
    return levels


def spot_and_line_responses(levels: list[FloatMap], kernels: list[FloatMap]) -> Iterator[FloatMap]:
    """Absolute responses of one field on the grid of cells, `RESPONSES` in all.

    The spots of every octave come first, then the lines of every octave and direction.
    """
    rows, columns = (side // HALF_CELL for side in levels[0].shape)
    for number, level in enumerate(levels):
        response = np.abs(level)
        if HALF_CELL >> number > 1:
            yield _cell_maximum(response, HALF_CELL >> number)
        else:
            yield resized(response, rows, columns)
    for number, level in enumerate(levels[:LINE_LEVELS]):
        for kernel in kernels:
            response = np.asarray(cv2.filter2D(level, cv2.CV_32F, kernel))
            yield _cell_maximum(np.abs(response, out=response), HALF_CELL >> number)


def line_kernels(orientation_deg: float) -> list[FloatMap]:
    """Line filters at `LINE_DIRECTIONS` directions of a texture at this orientation."""
    steps = np.arange(LINE_DIRECTIONS) * (180.0 / LINE_DIRECTIONS)
    return [_line_kernel(float(step + orientation_deg)) for step in steps]


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


def _line_kernel(direction_deg: float) -> FloatMap:
    """A line of pixels through the middle, anticlockwise from x, of unit sum of squares."""
    half = _LINE_PIXELS // 2
    kernel = np.zeros((_LINE_PIXELS + 2, _LINE_PIXELS + 2), np.float64)
    c, s = np.cos(np.radians(direction_deg)), np.sin(np.radians(direction_deg))
    steps = np.arange(-half, half + 1)
    x, y = half + 1 + steps * c, half + 1 - steps * s
    column, row = x.astype(int), y.astype(int)
    right, down = x - column, y - row
    # Bilinear shares of the four pixels around every point of the line.
    for across, x_share in ((0, 1 - right), (1, right)):
        for along, y_share in ((0, 1 - down), (1, down)):
            np.add.at(kernel, (row + along, column + across), x_share * y_share)
    return np.asarray(kernel / np.sqrt(np.sum(kernel**2)), np.float32)
