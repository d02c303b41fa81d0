"""Second pass of `ps4_robust`: fill in the pixels with fewer than three lights.

Two lights leave a line of scaled normals b0 + t d, one light or none leaves slope and albedo open.
Slope and albedo are chosen so that they change as little from pixel to pixel as elsewhere on this
surface, and that the gradient field is one of a surface: dp/dy = dq/dx.
"""

import numpy as np
import numpy.typing as npt

from classify.base.arrays import FloatMap, Indices
from classify.base.threads import run_on_rows
from classify.images import sample_pixels
from classify.lighting import Lighting

from .problem import Maps, Problem
from .relaxation import grow, neighbour_weights, relax
from .unsolved import LOST, NO_LINE, NOT_REACHED, SATURATED, Unsolved, link

_LIGHTS = np.uint8(15)  # the bits of `LOST` and `SATURATED` that are lights

# Number of squares of four pixels from which the smoothness of the surface is estimated.
_SAMPLES = 16_384
_PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
_FIRST, _SECOND = np.transpose(_PAIRS)
# By the bits of the lights that are dark: the pair of the two others, and the first dark one.
_PAIR_OF_DARK = np.full(16, NO_LINE)
for _index, (_j, _k) in enumerate(_PAIRS):
    _PAIR_OF_DARK[_LIGHTS ^ (1 << _j | 1 << _k)] = _index
_FIRST_DARK = np.array([3, *(int(b & -b).bit_length() - 1 for b in range(1, 16))], np.uint8)
# The next and the last of the three axes, for cross products.
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


def in_fill(problem: Problem, maps: Maps, strip_px: int) -> None:
    """Complete the maps in place where `Maps.unlit` is not 0.

    Pixels in two unsaturated lights become valid; pixels in fewer lights stay invalid.
    """
    unlit = maps.unlit
    assert unlit is not None
    pixels = _pixels_to_fill(unlit, strip_px)
    if not pixels.size:
        return
    solutions, along = _lines_of_two_lights(problem.lighting)
    values = problem.stack.values_at(pixels) * problem.gains[:, None]
    bits = unlit.ravel()[pixels]
    # Two lights of a dark pixel are not used (see `dark`).
    bits[values.sum(axis=0) < 4.0 * problem.dark_level] |= _LIGHTS
    pairs = _PAIR_OF_DARK[bits & _LIGHTS]
    lines = np.zeros((len(pixels), 4), np.float32)
    for pair, two in enumerate(_PAIRS):
        chosen = np.flatnonzero(pairs == pair)
        lines[chosen, :3] = values[:, chosen].take(two, 0).T @ solutions[pair].T
    unsolved = Unsolved.of(pixels, lines, pairs, along)
    planes = maps.p, maps.q, maps.albedo
    rows, columns = problem.shape
    corners = sample_pixels((rows - 1, columns - 1), _SAMPLES)
    squares = np.stack(np.divmod(corners, max(columns - 1, 1)), axis=1)
    albedo_weight, curl_weight = neighbour_weights(*planes, unlit, squares)
    # A pixel takes many times as long here as in the first pass: shorter parts.
    part = max(1, strip_px // 16)
    link(unsolved, unlit, curl_weight, *planes, part)
    grow(unsolved, albedo_weight, part)
    relax(unsolved, albedo_weight, curl_weight, part)
    reached = unsolved.depth != NOT_REACHED
    for plane, slopes in zip((maps.p, maps.q), unsolved.values.T, strict=False):
        plane.ravel()[pixels] = slopes
    pixels, bits = pixels[reached], bits[reached]
    maps.albedo.ravel()[pixels] = unsolved.values[reached, 2]
    maps.repaired.ravel()[pixels] = True
    maps.valid.ravel()[pixels] = (_PAIR_OF_DARK[bits & _LIGHTS] < NO_LINE) & (bits & SATURATED == 0)
    if maps.left_out is not None:
        maps.left_out.ravel()[pixels] = _FIRST_DARK[bits & _LIGHTS]


def _pixels_to_fill(unlit: npt.NDArray[np.uint8], strip_px: int) -> Indices:
    """Flat indices of the pixels that may be filled in."""
    columns = unlit.shape[1]
    pixels: dict[int, Indices] = {}

    def find(first: int, last: int) -> None:
        part = unlit[first:last].ravel()
        marked = np.flatnonzero(part != 0)
        pixels[first] = first * columns + marked[part[marked] != LOST]

    run_on_rows(find, unlit.shape, strip_px)
    return np.concatenate([pixels[first] for first in sorted(pixels)])


def _lines_of_two_lights(
    lighting: Lighting,
) -> tuple[FloatMap, FloatMap]:
    """(6, 3, 2) solutions and (7, 3) unit directions d of the lines of two lights.

    b0 = solutions[pair] (i_j, i_k) is that of the pseudo-inverse; d_z >= 0; the last d, 0, is no
    line.
    """
    first, second = lighting.directions[_FIRST], lighting.directions[_SECOND]
    cosines = (first * second).sum(axis=1, keepdims=True)
    solutions = np.stack([first - cosines * second, second - cosines * first], axis=2)
    solutions /= (1.0 - cosines**2)[..., None]
    along = np.zeros((len(_PAIRS) + 1, 3), np.float32)
    d = first[:, _NEXT] * second[:, _LAST] - first[:, _LAST] * second[:, _NEXT]
    sines = np.sqrt((d * d).sum(axis=1, keepdims=True))
    along[:-1] = d / np.where(d[:, 2:] < 0.0, -sines, sines)
    return solutions.astype(np.float32), along
