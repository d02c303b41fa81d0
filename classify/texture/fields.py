"""Texture fields: slopes and albedo of a surface estimate without outliers."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from classify.base.arrays import Array, FloatMap
from classify.base.compiling import kernel
from classify.base.errors import InputError
from classify.base.threads import run_on_rows
from classify.surface.estimate import SurfaceEstimate

# Bounds of slope and relative albedo. Where two or more lights are in shadow a solver can return
# any slope, and one such pixel outweighs a thousand others in a power spectrum; so does a bright
# speck in a dark albedo. `test_fields.py` and the shadow tests of test_joint.py test both.
_MAX_SLOPE = np.float32(2.0)
_MAX_ALBEDO = np.float32(8.0)
# Rows whose sums are taken in single precision; larger blocks would lose digits.
_ROWS = 16


@dataclass(frozen=True, eq=False)
class TextureFields:
    """Slopes of at most 2 and albedo in units of its mean, (H, W) each; means if not valid."""

    p: FloatMap
    q: FloatMap
    albedo: FloatMap

    @property
    def shape(self) -> tuple[int, int]:
        rows, columns = self.p.shape
        return rows, columns


def texture_fields(surface: SurfaceEstimate) -> TextureFields:
    """Compute the fields of a surface; InputError if no pixel is valid."""
    # One allocation instead of three: the allocator reuses a large block, but returns smaller ones
    # to the system, which has to clear their pages again.
    p, q, albedo = np.empty((3, *surface.shape), np.float32)
    rows, columns = surface.shape
    sums = np.empty((-(-rows // _ROWS), 4), np.float64)
    bound = partial(_bound, surface.p, surface.q, surface.albedo, surface.valid, p, q, albedo, sums)
    run_on_rows(bound, (len(sums), _ROWS * columns))
    count, p_sum, q_sum, albedo_sum = sums.sum(axis=0)
    if count == 0:
        raise InputError("no pixel of this surface is valid; check exposure and lights")
    if not np.isfinite([p_sum, q_sum, albedo_sum]).all():
        raise InputError("a valid pixel of this surface has a slope or albedo of NaN")
    if not albedo_sum > 0.0:
        raise InputError("the valid pixels of this surface reflect nothing; check exposure")
    means = (np.array([p_sum, q_sum, albedo_sum]) / count).astype(np.float32)
    run_on_rows(partial(_complete, surface.valid, means, p, q, albedo), surface.shape)
    return TextureFields(p, q, albedo)


@kernel
def _bound(
    p: Array, q: Array, albedo: Array, valid: Array,
    p_out: Array, q_out: Array, albedo_out: Array, sums: Array, first: int, stop: int,
) -> None:  # fmt: skip
    """Bound valid pixels, set others to 0; count and sum valid ones per block of rows."""
    rows, columns = p.shape
    zero, one = np.float32(0.0), np.float32(1.0)
    for block in range(first, stop):
        # Sums over the rows of each column, which the compiler vectorises without a change of the
        # order of additions.
        column_sums = np.zeros((4, columns), np.float32)
        for r in range(block * _ROWS, min((block + 1) * _ROWS, rows)):
            for c in range(columns):
                slope = np.sqrt(p[r, c] * p[r, c] + q[r, c] * q[r, c])
                # One factor for both components keeps the direction.
                factor = _MAX_SLOPE / max(slope, _MAX_SLOPE)
                p_out[r, c] = p[r, c] * factor if valid[r, c] else zero
                q_out[r, c] = q[r, c] * factor if valid[r, c] else zero
                albedo_out[r, c] = albedo[r, c] if valid[r, c] else zero
            for c in range(columns):
                column_sums[0, c] += one if valid[r, c] else zero
                column_sums[1, c] += p_out[r, c]
                column_sums[2, c] += q_out[r, c]
                column_sums[3, c] += albedo_out[r, c]
        for index in range(4):
            total = np.float64(0.0)
            for c in range(columns):
                total += column_sums[index, c]
            sums[block, index] = total


@kernel
def _complete(
    valid: Array, means: Array, p: Array, q: Array, albedo: Array, first: int, stop: int
) -> None:
    """Set pixels that are not valid to the mean; divide albedo by its mean."""
    columns = p.shape[1]
    one = np.float32(1.0)
    # Read outside the loop: elements of an array that may overlap another prevent vectorisation.
    p_mean, q_mean, inverse = means[0], means[1], one / means[2]
    for r in range(first, stop):
        for c in range(columns):
            p[r, c] = p[r, c] if valid[r, c] else p_mean
            q[r, c] = q[r, c] if valid[r, c] else q_mean
            albedo[r, c] = min(albedo[r, c] * inverse, _MAX_ALBEDO) if valid[r, c] else one
