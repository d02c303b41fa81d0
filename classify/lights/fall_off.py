"""Fall-off of each light over a planar part, from image ratios.

On a flat part, image k is l_z,k F_k times a factor common to all images, with F_k the strength of
the light. Near lights fall off smoothly, so that log F_k is a polynomial of low degree. Relief
raises the ratio of an image to the mean of all as much as it lowers it: the mean ratio of a planar
part does not depend on its relief. A tilt or bow of the part changes it, and is mistaken for
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
    FOLDS,
    MEDIAN_SQUARE,
    TUKEY,
    FlatField,
    coordinates,
    exponential,
    exponents,
    folded_basis,
    normal_equations,
    prediction_error,
    solve_normal_equations,
)

# Samples and blocks along each side of the frame. The means of blocks are fitted, so that relief
# finer than a block averages out. classify/DECISIONS.md compares 64 samples.
_SAMPLES, _BLOCKS = 128, 16
# Number of steps of the fit. After four, distances of 144 matches differ from those of the
# converged fit by 1.0 % rms under distant lights and by 0.3 % under lights at three fields of view;
# after three, by 1.9 and 3.6 %.
_ROUNDS = 4
# Largest factor of an extrapolated step.
_MAX_EXTRAPOLATION = 4.0
_DEGREE, _HIGHER_DEGREE = 2, 4
_TERMS = _HIGHER_DEGREE + 1
# The higher degree is used if its error of prediction is below `_CLEARLY_BETTER` times that of the
# lower one, and if at least `_MIN_REDUNDANT_SHARE` of the smooth ratio cannot be relief.
# classify/DECISIONS.md has both figures for photographs and materials.
_CLEARLY_BETTER, _MIN_REDUNDANT_SHARE = 0.5, 0.05
# A pixel darker than this share of the bright ones does not count: its ratio is that of noise to
# noise (tests/classify/lights/test_fall_off.py, a part beside a black board).
_DARK, _BRIGHT_QUANTILE = 0.05, 0.95
# Least number of lit blocks for a fit: an eighth of the frame. The polynomial of degree 2 has 6
# terms, and some of the blocks lie on a line.
_MIN_BLOCKS = 32
_TINY = 1e-30
_BLOCK_SAMPLES, _FOLD_BLOCKS = _SAMPLES // _BLOCKS, _BLOCKS // FOLDS
_FOLDED = FOLDS**2, _FOLD_BLOCKS**2
_INFINITY = np.uint32(0x7F800000)  # the bits of a float


def fall_off(
    stack: ImageStack,
    lighting: Lighting,
    full_scale: float | None,
    mask: BoolArray | None = None,
) -> FlatField | None:
    """Fit the fall-off of the lights over a planar part; None if too little is lit."""
    grid = _Grid.of(stack.shape)
    level_values = lighting.directions[:, 2] * lighting.intensities
    values = np.empty((len(lighting), _SAMPLES, _SAMPLES), np.float32)
    usable = np.ones((_SAMPLES, _SAMPLES), np.bool_)
    if mask is not None:
        usable[:] = mask[grid.rows[:, None], grid.columns]
    _read_samples(
        stack.images, stack.dark_rows, grid.rows, grid.columns,
        (level_values.mean() / level_values).astype(np.float32),
        np.float32(np.inf if full_scale is None else full_scale), values, usable,
    )  # fmt: skip
    samples = values, usable, grid.x, grid.y
    coefficients = np.zeros((len(lighting), _TERMS, _TERMS))
    means, weights = np.empty((len(lighting), *_FOLDED)), np.empty(_FOLDED)
    _refine(*samples, grid.bases[_DEGREE], *exponents(_DEGREE), coefficients, means, weights)
    if np.count_nonzero(weights) < _MIN_BLOCKS:
        return None
    low, high = (
        prediction_error(grid.bases[degree], means, weights) for degree in (_DEGREE, _HIGHER_DEGREE)
    )
    if high < _CLEARLY_BETTER * low:
        _block_means(*samples, np.zeros_like(coefficients), means, weights)
        if _excludes_relief(lighting, means, weights):
            basis, terms = grid.bases[_HIGHER_DEGREE], exponents(_HIGHER_DEGREE)
            _refine(*samples, basis, *terms, coefficients, means, weights)
    return FlatField(coefficients, _bounds(*samples[1:], coefficients))


@dataclass(frozen=True, eq=False)
class _Grid:
    """Samples of a frame, symmetric about its middle, and the blocks that they form."""

    rows: Indices  # (n,)
    columns: Indices  # (n,)
    x: FloatMap  # (n,) coordinates of the columns
    y: FloatMap  # (n,) coordinates of the rows
    bases: Mapping[int, Floats]  # `folded_basis` by degree

    @classmethod
    @lru_cache(maxsize=4)
    def of(cls, shape: tuple[int, int]) -> "_Grid":
        """The grid of frames of a shape."""
        rows, columns = (_positions(count) for count in shape)
        x, y = coordinates(rows, columns, shape)
        block_x, block_y = (axis.reshape(_BLOCKS, -1).mean(axis=1) for axis in (x, y))
        degrees = (_DEGREE, _HIGHER_DEGREE)
        bases = {degree: folded_basis(block_x, block_y, degree) for degree in degrees}
        return cls(rows, columns, x.astype(np.float32), y.astype(np.float32), bases)


@kernel
def _read_samples(
    images: Array, ambient: Array, rows: Array, columns: Array, scales: Array,
    saturation: np.float32, values: Array, usable: Array,
) -> None:  # fmt: skip
    """Write the samples minus the ambient image; saturated or dark samples are not usable."""
    lights, zero = len(images), np.float32(0.0)
    brightness, share = np.zeros(usable.shape, np.float32), np.float32(1.0 / lights)
    raw, dark = np.empty((2, len(columns)), np.float32)
    for r in range(len(rows)):
        for c in range(len(columns)):
            dark[c] = ambient[min(rows[r], len(ambient) - 1), columns[c]]
            brightness[r, c] = zero if usable[r, c] else -np.float32(np.inf)
        for k in range(lights):
            for c in range(len(columns)):  # a loop of its own, because it cannot be vectorised
                raw[c] = images[k, rows[r], columns[c]]
            for c in range(len(columns)):
                values[k, r, c] = (raw[c] - dark[c]) * scales[k]
                brightness[r, c] += share * values[k, r, c]
                usable[r, c] &= raw[c] < saturation
    brightness = np.maximum(brightness, zero)
    usable &= brightness > np.float32(_DARK) * _quantile(brightness, _BRIGHT_QUANTILE)


@kernel
def _quantile(values: Array, share: float) -> np.float32:
    """Quantile of the finite values, which are not negative, to 1 in 8192; 0 if there are none.

    A radix selection by two histograms of the bits, which have the order of the floats.
    """
    bits, prefix, rank = values.reshape(-1).view(np.uint32), np.uint32(0), -1
    for shift, digits in ((20, 11), (10, 10)):
        counts = np.zeros(1 << digits, np.int32)
        for word in bits:
            if word < _INFINITY and (rank < 0 or word >> np.uint32(20) == prefix):
                counts[(word >> np.uint32(shift)) & np.uint32((1 << digits) - 1)] += 1
        rank = int(share * counts.sum()) if rank < 0 else rank
        digit = 0
        while digit < len(counts) and counts[digit] <= rank:
            rank -= counts[digit]
            digit += 1
        if digit == len(counts):
            return np.float32(0.0)
        prefix = (prefix << np.uint32(digits)) | np.uint32(digit)
    ranked: np.float32 = np.array([prefix << np.uint32(10)]).view(np.float32)[0]
    return ranked


@kernel
def _refine(
    values: Array, usable: Array, x: Array, y: Array, basis: Array, i: Array, j: Array,
    coefficients: Array, means: Array, weights: Array,
) -> None:  # fmt: skip
    """Refine the coefficients by repeated weighted least squares of the residuals.

    Relief makes all steps too short, so each is extrapolated by the ratio of the last two (Irons
    and Tuck 1969).
    """
    factor, previous_step = 1.0, np.zeros((len(i), len(values)))
    for step_number in range(_ROUNDS):
        _block_means(values, usable, x, y, coefficients, means, weights)
        gram, right = normal_equations(basis, means, weights)
        step = solve_normal_equations(gram.sum(axis=0), right.sum(axis=0))
        if step_number > 0:
            change = previous_step - step
            factor *= (previous_step * change).sum() / max((change * change).sum(), _TINY)
            factor = min(max(factor, 1.0), _MAX_EXTRAPOLATION)
        for term in range(len(i)):
            coefficients[:, i[term], j[term]] += factor * step[term]
        previous_step = step


@kernel
def _block_means(
    values: Array, usable: Array, x: Array, y: Array, coefficients: Array, means: Array,
    weights: Array,
) -> None:  # fmt: skip
    """Write weighted means of ratio / strength - 1 in blocks, and the sums of Tukey's weights."""
    residuals, squares = np.empty_like(values), np.empty(usable.shape, np.float32)
    _residuals(values, usable, _row_factors(coefficients, y), x, residuals, squares)
    # The upper median.
    limit = max(np.float32(TUKEY**2 / MEDIAN_SQUARE) * _quantile(squares, 0.5), np.float32(_TINY))
    _sum_blocks(residuals, squares, limit, means, weights)


@kernel
def _residuals(
    values: Array, usable: Array, factors: Array, x: Array, residuals: Array, squares: Array
) -> None:
    """Write the residuals, value / mean of all lights - 1, and their mean squares.

    `squares` (n, n) are infinite where not usable. `factors` (N, n, 5) are of `_row_factors`.
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
def _row_factors(coefficients: Array, y: Array) -> Array:
    """(N, n, 5) coefficients of minus the polynomials in each row."""
    factors = np.zeros((len(coefficients), len(y), _TERMS), np.float32)
    for k in range(len(coefficients)):
        for r in range(len(y)):
            for i in range(_TERMS - 1, -1, -1):
                for j in range(_TERMS):
                    factors[k, r, j] = factors[k, r, j] * y[r] - np.float32(coefficients[k, i, j])
    return factors


@kernel
def _sum_blocks(
    residuals: Array, squares: Array, limit: np.float32, means: Array, weights: Array
) -> None:
    """Sum Tukey's weights over the samples of each block, and find weighted mean residuals."""
    lights, _, columns = residuals.shape
    zero, inverse = np.float32(0.0), np.float32(1.0) / limit
    for block in range(_BLOCKS):
        # Sums over the rows of each column, which the compiler vectorises without a change of the
        # order of additions.
        column_sums = np.zeros((1 + lights, columns), np.float32)
        row_weights = np.empty(columns, np.float32)
        for r in range(block * _BLOCK_SAMPLES, (block + 1) * _BLOCK_SAMPLES):
            for c in range(columns):
                weight = max(np.float32(1.0) - squares[r, c] * inverse, zero)
                row_weights[c] = weight * weight
                column_sums[0, c] += row_weights[c]
            for k in range(lights):
                for c in range(columns):
                    column_sums[1 + k, c] += residuals[k, r, c] * row_weights[c]
        for b in range(_BLOCKS):
            fold = block // _FOLD_BLOCKS * FOLDS + b // _FOLD_BLOCKS
            position = block % _FOLD_BLOCKS * _FOLD_BLOCKS + b % _FOLD_BLOCKS
            block_columns = column_sums[:, b * _BLOCK_SAMPLES : (b + 1) * _BLOCK_SAMPLES]
            weights[fold, position] = block_columns[0].sum()
            for k in range(lights):
                total = block_columns[1 + k].sum()
                means[k, fold, position] = total / max(weights[fold, position], _TINY)


@kernel
def _bounds(usable: Array, x: Array, y: Array, coefficients: Array) -> Array:
    """(N, 2) least and largest values of the polynomials at usable samples."""
    infinity, factors = np.float32(np.inf), _row_factors(coefficients, y)
    bounds = np.empty((len(factors), 2))
    for k in range(len(factors)):
        low, high = np.full(len(x), infinity), np.full(len(x), -infinity)
        for r in range(len(y)):
            c0, c1, c2, c3, c4 = factors[k, r]
            for c in range(len(x)):
                e = c0 + x[c] * (c1 + x[c] * (c2 + x[c] * (c3 + x[c] * c4)))
                low[c] = min(low[c], -e if usable[r, c] else infinity)
                high[c] = max(high[c], -e if usable[r, c] else -infinity)
        bounds[k] = low.min(), high.max()
    return bounds


def _positions(count: int) -> Indices:
    """Indices of the samples along a side, symmetric about its middle."""
    half = ((np.arange(_SAMPLES // 2) + 0.5) * count / _SAMPLES).astype(np.intp)
    return np.concatenate([half, count - 1 - half[::-1]])


def _excludes_relief(lighting: Lighting, means: Floats, weights: Floats) -> bool:
    """Whether relief cannot explain the residuals: it cancels in redundant combinations."""
    directions = lighting.directions / lighting.directions[:, 2:]
    cancelling = np.linalg.svd(directions.T)[2][3:]
    redundant = np.tensordot(cancelling, means, 1)
    redundant -= np.average(redundant, axis=(1, 2), weights=weights, keepdims=True)
    energy, total = (float((np.square(values) * weights).sum()) for values in (redundant, means))
    return energy > _MIN_REDUNDANT_SHARE**2 * total
