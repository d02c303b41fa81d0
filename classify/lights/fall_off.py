"""Fall-off of each light over a planar part, from image ratios.

On a flat part, image k is l_z,k F_k times what all images have in common, with F_k the strength of
the light. Near lights fall off smoothly, so that log F_k is a polynomial of low degree. Relief
raises the ratio of an image to the mean of all as much as it lowers it: the mean ratio of a planar
part does not depend on its relief. A tilt or bow of the part does change it and is taken for
fall-off.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from classify.base.arrays import Array, BoolArray, FloatMap, Floats, Indices
from classify.base.compiling import kernel
from classify.images import ImageStack
from classify.lighting import Lighting
from classify.shadow_rule import MAYBE_SHADOW

from .flat_field import (
    MEDIAN_SQUARE,
    TUKEY,
    FlatField,
    by_fold,
    coordinates,
    exponential,
    exponents,
    normal_equations,
    powers,
    prediction_error,
    solved,
)

# Along each side of the frame. Means of blocks are fitted: relief finer than a block averages out.
# classify/DECISIONS.md compares 64 samples.
_SAMPLES, _BLOCKS = 128, 16
# Steps. Distances of 144 matches then differ from those of the converged fit by 1.0 % rms under
# distant lights and by 0.3 % under lights at three fields of view, after three by 1.9 and 3.6 %.
_ROUNDS = 4
# Largest factor of an extrapolated step.
_FURTHEST = 4.0
_DEGREE, _HIGHER_DEGREE = 2, 4
_TERMS = _HIGHER_DEGREE + 1
# The higher degree is taken where its error of prediction is below the first share of the lower
# one's, and at least the second share of the smooth ratio cannot be relief. classify/DECISIONS.md
# has both figures for photographs and materials.
_CLEARLY_BETTER, _NO_RELIEF = 0.5, 0.05
# A pixel darker than this share of the bright ones does not count: its ratio is that of noise to
# noise (tests/classify/lights/test_fall_off.py, a part beside a black board).
_DARK, _BRIGHT = 0.05, 0.95
# With fewer blocks in light, an eighth of the frame, nothing is fitted. The polynomial of degree 2
# has 6 terms, and some of the blocks lie in a line.
_MIN_BLOCKS = 32
_TINY = 1e-30
_BLOCK_SAMPLES = _SAMPLES // _BLOCKS


def fall_off(
    stack: ImageStack,
    lighting: Lighting,
    full_scale: float | None,
    mask: BoolArray | None = None,
) -> FlatField | None:
    """Fit the fall-off of the lights over a planar part; None if too little is lit."""
    samples = _Samples.of(stack, lighting, full_scale, mask)
    even = np.zeros((len(lighting), _TERMS, _TERMS))
    coefficients, residuals, weights = samples.refined(even, _DEGREE)
    if np.count_nonzero(weights) < _MIN_BLOCKS:
        return None
    low, high = (
        prediction_error(samples.grid.bases[degree], residuals, weights)
        for degree in (_DEGREE, _HIGHER_DEGREE)
    )
    if high < _CLEARLY_BETTER * low and _no_relief(lighting, *samples.residuals(even)):
        coefficients, *_ = samples.refined(coefficients, _HIGHER_DEGREE)
    logarithms = [values[samples.usable] for values in samples.grid.polynomials(coefficients)]
    return FlatField(
        coefficients, np.array([(values.min(), values.max()) for values in logarithms])
    )


@dataclass(frozen=True, eq=False)
class _Grid:
    """Samples of a frame, symmetric about its middle, and the blocks that they form."""

    pixels: Indices  # (n * n,) flat indices of the samples
    x_powers: Floats  # (n, 5)
    y_powers: Floats  # (n, 5)
    bases: Mapping[int, Floats]  # by degree, (folds, blocks, terms) of y^i x^j, as `exponents`

    @classmethod
    @lru_cache(maxsize=4)
    def of(cls, shape: tuple[int, int]) -> "_Grid":
        """The grid of frames of a shape."""
        rows, columns = (_positions(count) for count in shape)
        x, y = coordinates(rows, columns, shape)
        block_x, block_y = (
            powers(axis.reshape(_BLOCKS, -1).mean(axis=1), _TERMS) for axis in (x, y)
        )
        bases = {}
        for degree in (_DEGREE, _HIGHER_DEGREE):
            i, j = exponents(degree)
            terms = block_y.T[i][:, :, None] * block_x.T[j][:, None, :]
            bases[degree] = np.moveaxis(by_fold(terms), 0, -1)
        pixels = (rows[:, None] * shape[1] + columns).ravel()
        return cls(pixels, powers(x, _TERMS), powers(y, _TERMS), bases)

    def polynomials(self, coefficients: Floats) -> FloatMap:
        """(N, n, n) values of polynomials at the samples."""
        values: Floats = self.y_powers @ coefficients @ self.x_powers.T
        return values.astype(np.float32)


@dataclass(frozen=True, eq=False)
class _Samples:
    """Pixels of a grid."""

    grid: _Grid
    values: FloatMap  # (N, n, n), equal on a flat part under equal lights
    usable: BoolArray  # (n, n), not outside the mask, saturated or dark

    @classmethod
    def of(
        cls,
        stack: ImageStack,
        lighting: Lighting,
        full_scale: float | None,
        mask: BoolArray | None,
    ) -> "_Samples":
        grid = _Grid.of(stack.shape)
        raw = stack.raw_at(grid.pixels)
        flat = lighting.directions[:, 2] * lighting.intensities
        values = raw - stack.dark_at(grid.pixels)
        values *= (flat.mean() / flat).astype(np.float32)[:, None]
        brightness = values.mean(axis=0)
        if mask is not None:
            brightness *= mask.ravel()[grid.pixels]
        bright = int(_BRIGHT * brightness.size)
        usable = brightness > _DARK * np.partition(brightness, bright)[bright]
        if full_scale is not None:
            usable &= raw.max(axis=0) < full_scale
        square = (_SAMPLES, _SAMPLES)
        return cls(grid, values.reshape(-1, *square), usable.reshape(square))

    def residuals(self, coefficients: Floats) -> tuple[Floats, Floats]:
        """(N, folds, blocks) means of ratio / strength - 1, and Tukey's weights."""
        factors = (-self.grid.y_powers @ coefficients).astype(np.float32)
        residuals = np.empty_like(self.values)
        squares = np.empty(self.usable.shape, np.float32)
        x = self.grid.x_powers[:, 1].astype(np.float32)
        _find_residuals(self.values, self.usable, factors, x, residuals, squares)
        # The upper median, in a tenth of the time of the mean of the middle two.
        lit = squares[squares < np.inf]
        middle = np.partition(lit, lit.size // 2)[lit.size // 2] if lit.size else _TINY
        limit = np.float32(max(TUKEY**2 / MEDIAN_SQUARE * middle, _TINY))
        sums = np.empty((1 + len(residuals), _BLOCKS, _BLOCKS))
        _sum_blocks(residuals, squares, limit, sums)
        folds = by_fold(sums)
        return folds[1:] / np.maximum(folds[0], _TINY), folds[0]

    def refined(self, coefficients: Floats, degree: int) -> tuple[Floats, Floats, Floats]:
        """Coefficients for which the residuals vanish; residuals and weights before the last step.

        Weighted least squares, repeated. Relief makes all steps too short by about one factor: it
        is estimated from the last two steps, and the next one is that much longer (Irons and Tuck
        1969).
        """
        basis, (i, j) = self.grid.bases[degree], exponents(degree)
        refined, previous_step, factor = coefficients.copy(), None, 1.0
        for _ in range(_ROUNDS):
            residuals, weights = self.residuals(refined)
            gram, right = normal_equations(basis, residuals, weights)
            step = solved(gram.sum(axis=0), right.sum(axis=0)).T
            if previous_step is not None:
                change = previous_step - step
                factor *= float(
                    (previous_step * change).sum() / max(np.square(change).sum(), _TINY)
                )
                factor = min(max(factor, 1.0), _FURTHEST)
            refined[:, i, j] += factor * step
            previous_step = step
        return refined, residuals, weights


@kernel
def _find_residuals(
    values: Array, usable: Array, factors: Array, x: Array, residuals: Array, squares: Array
) -> None:
    """Write the residuals: ratio of a value to the mean of all lights, minus 1.

    `factors` (N, n, 5) are of the polynomial in each row, `squares` (n, n) the means over the
    lights, infinite where a sample is not usable or may be in shadow.
    """
    lights, rows, columns = values.shape
    zero, one, share = np.float32(0.0), np.float32(1.0), np.float32(1.0 / lights)
    shadow, infinity = np.float32(MAYBE_SHADOW), np.float32(np.inf)
    low, high, total = np.empty((3, columns), np.float32)
    for r in range(rows):
        low[:], high[:], total[:] = infinity, -infinity, zero
        for k in range(lights):
            c0, c1, c2, c3, c4 = factors[k, r]
            for c in range(columns):
                e = c0 + x[c] * (c1 + x[c] * (c2 + x[c] * (c3 + x[c] * c4)))
                # Far from a small part the polynomial may be beyond what exp can represent.
                value = values[k, r, c] * exponential(e if usable[r, c] else zero)
                residuals[k, r, c] = value
                low[c], high[c] = min(low[c], value), max(high[c], value)
                total[c] += value
        for c in range(columns):
            lit = usable[r, c] & (low[c] > shadow * high[c])
            total[c] = one / (share * total[c]) if lit else zero
            squares[r, c] = zero if lit else infinity
        for k in range(lights):
            for c in range(columns):
                residual = residuals[k, r, c] * total[c] - one
                residuals[k, r, c] = residual
                squares[r, c] += share * residual * residual


@kernel
def _sum_blocks(residuals: Array, squares: Array, limit: np.float32, sums: Array) -> None:
    """Sum Tukey's weights, and the weighted residuals, over the samples of each block."""
    lights, _, columns = residuals.shape
    zero, one = np.float32(0.0), np.float32(1.0)
    inverse = one / limit
    for block in range(_BLOCKS):
        # Sums of columns, which vectorise without changing the order of additions.
        lines = np.zeros((1 + lights, columns), np.float32)
        weights = np.empty(columns, np.float32)
        for r in range(block * _BLOCK_SAMPLES, (block + 1) * _BLOCK_SAMPLES):
            for c in range(columns):
                weight = max(one - squares[r, c] * inverse, zero)
                weights[c] = weight * weight
                lines[0, c] += weights[c]
            for k in range(lights):
                for c in range(columns):
                    lines[1 + k, c] += residuals[k, r, c] * weights[c]
        for k in range(1 + lights):
            for b in range(_BLOCKS):
                sums[k, block, b] = lines[k, b * _BLOCK_SAMPLES : (b + 1) * _BLOCK_SAMPLES].sum()


def _positions(count: int) -> Indices:
    """Indices of the samples along a side, symmetric about its middle."""
    half = ((np.arange(_SAMPLES // 2) + 0.5) * count / _SAMPLES).astype(np.intp)
    return np.concatenate([half, count - 1 - half[::-1]])


def _no_relief(lighting: Lighting, means: Floats, weights: Floats) -> bool:
    """Whether relief, which cancels in combinations of four lights, cannot explain residuals."""
    directions = lighting.directions / lighting.directions[:, 2:]
    cancelling = np.linalg.svd(directions.T)[2][3:]
    redundant = np.tensordot(cancelling, means, 1)
    redundant -= np.average(redundant, axis=(1, 2), weights=weights, keepdims=True)
    energy, total = (float((np.square(values) * weights).sum()) for values in (redundant, means))
    return energy > _NO_RELIEF**2 * total
