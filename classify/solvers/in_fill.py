"""Second pass of `ps4_robust`: fill in the pixels with fewer than three lights.

Two lights leave a line of scaled normals b0 + t d, one light or none leaves slope and albedo open.
Slope and albedo are chosen to be as smooth as elsewhere on this surface, and to make the gradient
field integrable: dp/dy = dq/dx.
"""

from functools import lru_cache

import numpy as np

from classify.base.arrays import Array, FloatMap, Indices
from classify.base.compiling import kernel
from classify.images import sample_pixels
from classify.lighting import Lighting

from .problem import Maps, Problem
from .relaxation import grow, neighbour_weights, relax
from .unsolved import LIGHTS, LOST, NO_LINE, NOT_REACHED, SATURATED, Unsolved, link

# Number of blocks of 2 x 2 pixels from which the smoothness of the surface is estimated.
_SAMPLES = 16_384
_PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
_FIRST, _SECOND = np.ascontiguousarray(np.transpose(_PAIRS))
# Tables by the bits of the dark lights: index of the pair of the two others, and the first dark
# light, that of the lowest bit. Entry 0, no dark light, is not used.
_PAIR_OF_DARK = np.full(16, NO_LINE)
for _index, (_j, _k) in enumerate(_PAIRS):
    _PAIR_OF_DARK[LIGHTS ^ (1 << _j | 1 << _k)] = _index
_FIRST_DARK = np.array([3, *((bits & -bits).bit_length() - 1 for bits in range(1, 16))], np.uint8)


def in_fill(problem: Problem, maps: Maps) -> None:
    """Complete the maps in place where `Maps.unlit` is not 0.

    Pixels in two unsaturated lights become valid.
    """
    unlit = maps.unlit
    assert unlit is not None
    assert maps.left_out is not None
    pixels = np.flatnonzero((unlit & ~LOST) != 0)
    if not pixels.size:
        return
    solutions, line_directions = _lines_of_two_lights(problem.lighting)
    values = problem.stack.values_at(pixels) * problem.gains[:, None]
    bits = unlit.ravel()[pixels]
    pairs, lines = np.empty_like(bits), np.empty((len(pixels), 4), np.float32)
    _choose_lines(values, problem.dark_level, solutions, bits, pairs, lines)
    unsolved = Unsolved.of(pixels, lines, pairs, line_directions)
    planes = maps.p, maps.q, maps.albedo
    weights = neighbour_weights(*planes, unlit, _corners(problem.shape))
    albedo_weight, curl_weight = map(np.float32, weights)  # compiled functions return float
    link(unsolved, unlit, curl_weight, *planes)
    grow(unsolved, albedo_weight)
    relax(unsolved, albedo_weight, curl_weight)
    written = (*planes, maps.valid, maps.repaired, maps.left_out)
    _write(unsolved.values, unsolved.layers, pixels, bits, *(plane.ravel() for plane in written))


@kernel
def _choose_lines(
    values: Array, dark_level: np.float32, solutions: Array, bits: Array, pairs: Array, lines: Array
) -> None:
    """Write the pair of lights of each pixel, and b0 of its line; add lights to `bits`."""
    for n in range(len(bits)):
        # A dark pixel has no usable light (see `problem._DARK`).
        if (values[0, n] + values[1, n]) + (values[2, n] + values[3, n]) < 4.0 * dark_level:
            bits[n] |= LIGHTS
        pair = _PAIR_OF_DARK[bits[n] & LIGHTS]
        pairs[n] = pair
        lines[n] = np.float32(0.0)
        if pair < NO_LINE:
            first, second = values[_FIRST[pair], n], values[_SECOND[pair], n]
            for x in range(3):
                lines[n, x] = solutions[pair, x, 0] * first + solutions[pair, x, 1] * second


@kernel
def _write(
    values: Array, layers: Array, pixels: Array, bits: Array,
    p: Array, q: Array, albedo: Array, valid: Array, repaired: Array, left_out: Array,
) -> None:  # fmt: skip
    """Write the filled-in values to the maps, which are raveled."""
    for n in range(len(pixels)):
        m = pixels[n]
        p[m], q[m] = values[n, 0], values[n, 1]
        if layers[n] != NOT_REACHED:
            dark = bits[n] & LIGHTS
            albedo[m] = values[n, 2]
            repaired[m] = True
            valid[m] = (_PAIR_OF_DARK[dark] < NO_LINE) & (bits[n] & SATURATED == 0)
            left_out[m] = _FIRST_DARK[dark]


@lru_cache(maxsize=8)
def _corners(shape: tuple[int, int]) -> Indices:
    """(n, 2) row and column of the upper left pixels of blocks of 2 x 2, evenly spread."""
    rows, columns = shape
    corners = sample_pixels((rows - 1, columns - 1), _SAMPLES)
    return np.stack(np.divmod(corners, max(columns - 1, 1)), axis=1)


@lru_cache(maxsize=8)
def _lines_of_two_lights(lighting: Lighting) -> tuple[FloatMap, FloatMap]:
    """Pseudo-inverses (6, 3, 2) of the pairs of lights, and directions d (8, 3) of their lines."""
    # The line of a pair has b0 = solutions[pair] (i_j, i_k), and a d of length 1 with d_z >= 0. For
    # `NO_LINE` and `SKIPPED`, d is 0.
    first, second = lighting.directions[_FIRST], lighting.directions[_SECOND]
    cosines = (first * second).sum(axis=1, keepdims=True)
    solutions = np.stack([first - cosines * second, second - cosines * first], axis=2)
    solutions /= (1.0 - cosines**2)[..., None]
    line_directions = np.zeros((len(_PAIRS) + 2, 3), np.float32)
    d = np.cross(first, second)
    sines = np.sqrt((d * d).sum(axis=1, keepdims=True))
    line_directions[:-2] = d / np.where(d[:, 2:] < 0.0, -sines, sines)
    return solutions.astype(np.float32), line_directions
