"""Constants of the solvers that follow from the light directions alone."""

from functools import lru_cache

import numpy as np

from classify.base.arrays import FloatMap, Floats
from classify.base.errors import InputError
from classify.lighting import Lighting

# Smallest singular value of three light directions that determines a normal: at 1e-3, noise of a
# thousandth of the signal makes a slope error of 1.
_MIN_SINGULAR_VALUE = 1e-3


@lru_cache(maxsize=16)
def drop_one_constants(lighting: Lighting, method: str) -> tuple[Floats, Floats]:
    """pinv(L) (3, 4) and nul (4,) of length 1, for four lights in general position."""
    L = lighting.directions
    if len(L) != 4:
        raise InputError(
            f"method {method} needs exactly 4 lights, this set has {len(L)}; "
            "use least_squares for 3 or for 5 and more"
        )
    # The smallest singular value of the lights without light k is at least |nul_k| times that of
    # all four (Cramer's rule, and singular values interlace).
    u, singular, v = np.linalg.svd(L.T)
    singular_bounds = np.abs(v[3]) * singular[2]
    if singular_bounds.min() < _MIN_SINGULAR_VALUE:
        raise InputError(
            f"without light {np.argmin(singular_bounds)} the other three lie in one plane; "
            f"{method} needs any three of the four to determine the normal"
        )
    pinv, null = (u / singular) @ v[:3], v[3]
    pinv.flags.writeable = null.flags.writeable = False
    return pinv, null


def require_solvable(lighting: Lighting) -> None:
    """Raise InputError with the reason if no method can solve under these lights."""
    L = lighting.directions
    cosines = L @ L.T
    # A light counts if none before it is within 0.1 degrees.
    max_cosine = np.cos(np.radians(0.1))
    distinct = sum(not (cosines[k, :k] > max_cosine).any() for k in range(len(L)))
    if distinct < 3:
        raise InputError(
            f"lights in different directions: {distinct} of {len(L)}; slopes need at least three, "
            "not all in one plane"
        )
    if np.linalg.svd(L, compute_uv=False)[-1] < _MIN_SINGULAR_VALUE:
        raise InputError(
            f"the {len(L)} lights lie in one plane with the surface point, so that slopes across "
            "it are unknown; give a light beside it"
        )


def solvable_pinv(directions: Floats, method: str) -> FloatMap:
    """(3, N) weights with b = weights i; InputError if the lights determine no normal."""
    singular = np.linalg.svd(directions, compute_uv=False)
    if len(directions) < 3 or singular[-1] < _MIN_SINGULAR_VALUE:
        raise InputError(
            f"{method} cannot solve from {len(directions)} lights that do not span three "
            "dimensions; at least three are needed, not all in one plane"
        )
    return np.linalg.pinv(directions).astype(np.float32)
