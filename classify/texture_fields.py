"""What of a surface estimate is compared as texture: slopes and albedo without their outliers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from .errors import InputError
from .kernels import FAST
from .surface import FloatMap, SurfaceEstimate

__all__ = ["TextureFields", "texture_fields"]

# Where two or more lights are in shadow a solver can return any slope; one such pixel outweighs
# a thousand others in a power spectrum unless it is bounded.
_MAX_SLOPE = np.float32(2.0)
# The same for a speck in a dark albedo.
_MAX_ALBEDO = np.float32(8.0)

Array = npt.NDArray[Any]


@dataclass(frozen=True, eq=False)
class TextureFields:
    """Slopes of at most 2 and albedo in units of its mean, (H, W) float32 each.

    Pixels that are not valid have the mean slope and the mean albedo.
    """

    p: FloatMap
    q: FloatMap
    albedo: FloatMap

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.p.shape
        return rows, columns


def texture_fields(surface: SurfaceEstimate) -> TextureFields:
    """The fields of a surface.

    Raises
    ------
    InputError
        If no pixel is valid, or the valid ones have no albedo at all, or hold what is no number.
    """
    sums = np.empty((surface.shape[0], 4), np.float64)
    _row_sums(surface.p, surface.q, surface.albedo, surface.valid, sums)
    count, p_sum, q_sum, albedo_sum = sums.sum(axis=0)
    if count == 0:
        raise InputError("no pixel of this surface is valid; check exposure and lights")
    if not np.isfinite([p_sum, q_sum, albedo_sum]).all():
        raise InputError("a valid pixel of this surface has a slope or albedo that is no number")
    if not albedo_sum > 0.0:
        raise InputError("the valid pixels of this surface reflect nothing; check exposure")
    means = (np.array([p_sum, q_sum, albedo_sum]) / count).astype(np.float32)
    # One block of memory and not three: a large one is used again once it was given back, while
    # the pages of small ones are each asked of the system anew.
    p, q, albedo = np.empty((3, *surface.shape), np.float32)
    _bounded(surface.p, surface.q, surface.albedo, surface.valid, means, p, q, albedo)
    return TextureFields(p, q, albedo)


@njit(fastmath=FAST, cache=True, error_model="numpy")
def _shortening(p: np.float32, q: np.float32) -> np.float32:
    """Factor that bounds a slope and keeps its direction."""
    factor: np.float32 = _MAX_SLOPE / max(np.sqrt(p * p + q * q), _MAX_SLOPE)
    return factor


@njit(parallel=True, fastmath=FAST, cache=True, error_model="numpy")
def _row_sums(p: Array, q: Array, albedo: Array, valid: Array, sums: Array) -> None:
    """Per row the count of valid pixels and the sums of their bounded slopes and albedo."""
    rows, columns = p.shape
    zero = np.float32(0.0)
    for r in prange(rows):
        count = p_sum = q_sum = albedo_sum = np.float64(0.0)
        for c in range(columns):
            factor = _shortening(p[r, c], q[r, c])
            count += valid[r, c]
            p_sum += p[r, c] * factor if valid[r, c] else zero
            q_sum += q[r, c] * factor if valid[r, c] else zero
            albedo_sum += albedo[r, c] if valid[r, c] else zero
        sums[r, 0], sums[r, 1], sums[r, 2], sums[r, 3] = count, p_sum, q_sum, albedo_sum


@njit(parallel=True, fastmath=FAST, cache=True, error_model="numpy")
def _bounded(
    p: Array, q: Array, albedo: Array, valid: Array, means: Array,
    p_out: Array, q_out: Array, albedo_out: Array,
) -> None:  # fmt: skip
    rows, columns = p.shape
    inverse = np.float32(1.0) / means[2]
    for r in prange(rows):
        for c in range(columns):
            factor = _shortening(p[r, c], q[r, c])
            known = valid[r, c]
            p_out[r, c] = p[r, c] * factor if known else means[0]
            q_out[r, c] = q[r, c] * factor if known else means[1]
            albedo_out[r, c] = (
                min(albedo[r, c] * inverse, _MAX_ALBEDO) if known else np.float32(1.0)
            )
