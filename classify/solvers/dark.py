"""Dark pixels, at which a missing light is not taken for shadow."""

import math

import numpy as np

from classify.images.stack import ImageStack
from classify.shadow_rule import SHADOW_FLOOR, SHADOW_FRACTION

from .problem import Maps, Problem
from .unsolved import LOST

# A light is missing if it is below the shadow limit, and below the prediction by this many standard
# deviations: one normal deviate in 740 is.
_MISSING = 3.0


def judge_dark_pixels(
    problem: Problem, stack: ImageStack, maps: Maps, first: int, last: int
) -> None:
    """Invalidate dark pixels of rows `first` to `last` at which a light is missing.

    A dark pixel (`Problem.dark_level`) gets much of its light from the lens and its surroundings,
    so there a missing light is no evidence of shadow; the problem must hold the solver's
    intensities.
    """
    part = maps.rows(first, last)
    if not part.dark_counts.any():
        return
    # The prediction from the other lights is noisy as well: 2 sigma of the difference for four.
    lights = len(problem.lighting)
    noise = np.float32(_MISSING * problem.sigma * math.sqrt(lights / max(lights - 3, 1)))
    p, q, albedo, valid = part.p.ravel(), part.q.ravel(), part.albedo.ravel(), part.valid.ravel()
    pixels = np.flatnonzero((albedo < problem.dark_albedo) & valid)
    values = stack.values_at(first * problem.shape[1] + pixels) * problem.gains[:, None]
    dark = values.mean(axis=0) < problem.dark_level
    pixels, values = pixels[dark], values[:, dark]
    rho = albedo[pixels]
    normals = np.stack([-p[pixels], -q[pixels], np.ones_like(rho)])
    normals *= rho / np.sqrt(np.square(normals).sum(axis=0))
    predicted = np.maximum(problem.directions @ normals, SHADOW_FLOOR * rho)
    missing = (values <= SHADOW_FRACTION * predicted) & (predicted - values > noise)
    pixels = pixels[missing.any(axis=0)]
    p[pixels] = q[pixels] = 0.0
    valid[pixels] = False
    if part.unlit is not None:
        part.unlit.ravel()[pixels] = LOST
