"""Dark pixels, at which a missing light is not taken for shadow."""

import math

import numpy as np
import numpy.typing as npt

from classify.shadow_rule import SHADOW_FLOOR, SHADOW_FRACTION
from classify.threads import run_on_rows

from .problem import Maps, Problem

# A light is missing if it is below the shadow limit, and below the prediction by so many standard
# deviations.
_BEYOND_NOISE = 3.0
# To save time, the values of pixels of a larger albedo are not read, as a multiple of that of a
# dark pixel that faces the camera: those are bright, or steeper than most surfaces.
_LARGEST_ALBEDO = 3.0


def judge_dark_pixels(problem: Problem, maps: Maps) -> npt.NDArray[np.intp]:
    """Invalidate dark pixels whose values are not those of a surface in all its lights.

    A pixel that is dark beside the rest of the frame (`Problem.dark_level`) gets much of its light
    from the lens and its surroundings, and a backdrop is lit by some of the LEDs only. There a
    missing light is no evidence of shadow, and the others do not show a slope. The problem must
    hold the intensities with which the maps were solved.

    Returns
    -------
    The flat indices of these pixels.
    """
    largest = _LARGEST_ALBEDO * problem.dark_level / problem.directions[:, 2].mean()
    # The prediction from the other lights is noisy as well: 2 sigma of the difference for four.
    lights = len(problem.lighting)
    noise = np.float32(_BEYOND_NOISE * problem.sigma * math.sqrt(lights / max(lights - 3, 1)))
    columns = problem.shape[1]
    found: dict[int, npt.NDArray[np.intp]] = {}
    p, q, albedo, valid = (plane.ravel() for plane in (maps.p, maps.q, maps.albedo, maps.valid))

    def judge(first: int, last: int) -> None:
        rows = slice(first * columns, last * columns)
        maybe = albedo[rows] < largest
        if not maybe.any():
            return
        pixels = rows.start + np.flatnonzero(maybe & valid[rows])
        values = problem.stack.values_at(pixels) * problem.gains[:, None]
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
        found[first] = pixels

    run_on_rows(judge, problem.shape)
    return np.concatenate([np.empty(0, np.intp), *found.values()])
