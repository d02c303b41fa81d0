"""Constants of the solvers that follow from the light directions alone."""

from functools import lru_cache

import numpy as np

from classify.base.arrays import FloatMap, Floats
from classify.base.errors import InputError
from classify.lighting import Lighting

# Smallest singular value of three light directions that determines a normal: at 1e-3, noise of a
# thousandth of the signal makes a slope error of 1.
_MIN_SINGULAR_VALUE = 1e-3
# Tilt of the light that each version of PS3 leaves out (thesis section 9.3).
_PS3_UNUSED_TILT_DEG = {"ps3a": 270.0, "ps3b": 0.0, "ps3c": 90.0, "ps3d": 180.0}


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


@lru_cache(maxsize=16)
def least_squares_weights(lighting: Lighting, method: str) -> FloatMap:
    """(3, N) weights with b = weights i from all lights."""
    return _pseudo_inverse(lighting.directions, method)


def three_of_ring(lighting: Lighting, method: str) -> tuple[FloatMap, int]:
    """(3, 4) weights of a version of PS3, and the index of the light left out."""
    if len(lighting) != 4:
        raise InputError(
            f"method {method} chooses 3 of 4 lights, this set has {len(lighting)}; "
            "use least_squares"
        )
    unused = lighting.light_nearest_tilt(_PS3_UNUSED_TILT_DEG[method])
    used = np.arange(4) != unused
    weights = np.zeros((3, 4), dtype=np.float32)
    weights[:, used] = _pseudo_inverse(lighting.directions[used], method)
    return weights, unused


def drop_two_inverses(lighting: Lighting) -> FloatMap:
    """(N, N, 3, 3) inverses of L^T L without lights i and j; NaN if singular."""
    # Entries [i, i] are the inverse for all lights.
    L = lighting.directions
    count = len(L)
    if count < 5:
        raise InputError(
            f"method rushmeier drops 2 of at least 5 lights, this set has {count}; "
            "use ps4_robust for 4"
        )
    outer = L[:, :, None] * L[:, None, :]
    gram = outer.sum(axis=0) - outer[:, None] - outer[None, :]
    gram[np.arange(count), np.arange(count)] = outer.sum(axis=0)
    is_singular = np.linalg.eigvalsh(gram)[..., 0] < _MIN_SINGULAR_VALUE**2
    if is_singular[~np.eye(count, dtype=bool)].all():
        raise InputError(
            "whichever two lights are dropped, the others lie in one plane; rushmeier needs "
            "lights in general position"
        )
    gram[is_singular] = np.eye(3)
    inverses = np.linalg.inv(gram).astype(np.float32)
    inverses[is_singular] = np.nan
    return inverses


def _pseudo_inverse(directions: Floats, method: str) -> FloatMap:
    singular = np.linalg.svd(directions, compute_uv=False)
    if len(directions) < 3 or singular[-1] < _MIN_SINGULAR_VALUE:
        raise InputError(
            f"{method} cannot solve from {len(directions)} lights that do not span three "
            "dimensions; at least three are needed, not all in one plane"
        )
    return np.linalg.pinv(directions).astype(np.float32)
