"""Where the page shows the image of each light: as the lights stand around the part."""

from itertools import combinations
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

# Images that are smaller than a seventh of the page show neither focus nor framing.
_LEAST_SHARE = 1.0 / 7.0
# Lights whose directions differ by less, as a share of the ring, have no places of their own.
_LEAST_GAP = 1e-3


class Places(NamedTuple):
    """Places on the page as shares of its width or height."""

    lights: tuple[tuple[float, float], ...]  # (left, top) of each
    part: tuple[float, float]  # in the middle
    size: float  # width and height of each image


def places_of(directions: npt.NDArray[np.float64]) -> Places | None:
    """Place images as the lights stand, by their (N, 3) directions with y up.

    The images are the largest that overlap neither each other nor the part; None if they are
    smaller than a seventh of the page, as for a light above the part or a dome of many.
    """
    offsets = directions[:, :2] * (1.0, -1.0)  # on the page y points down
    reach = np.abs(offsets).max(initial=_LEAST_GAP)
    centres = np.vstack([offsets / reach, np.zeros((1, 2))])
    gap = min(np.abs(one - other).max() for one, other in combinations(centres, 2))
    if gap < _LEAST_GAP:
        return None
    # In units of an image: centres lie within +-1/gap, and images reach half an image further.
    low, high = centres.min(axis=0), centres.max(axis=0)
    spans = (high - low) / gap + 1.0
    size = 1.0 / float(spans.max())
    if size < _LEAST_SHARE:
        return None
    corners = (centres - 0.5 * (low + high)) * size / gap + 0.5 - 0.5 * size
    *lights, part = [(float(left), float(top)) for left, top in corners.round(4)]
    return Places(tuple(lights), part, round(size, 4))
