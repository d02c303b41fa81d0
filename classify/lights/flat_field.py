"""Strength of each light over a plane: log-polynomial model, division, and parts of its fit."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from classify.base.arrays import Array, FloatMap, Floats, Indices
from classify.base.compiling import kernel
from classify.base.errors import InputError
from classify.base.threads import run_on_rows
from classify.images import ImageStack
from classify.lighting import Lighting

# Coefficients per coordinate in the kernel: degree 6, which LEDs at two fields of view need
# (tests/classify/calibration/test_flat_field.py).
TERMS = 7
_MAX_LOGARITHM = 80.0  # exp(88.7) overflows float32
# Number of intervals of the longer side. Strengths are computed in three rows of an interval, and
# by a parabola between them. The error is up to 3e-6 where light falls off by half, a fraction of a
# digit of 16 bits.
_INTERVALS = 64


@dataclass(frozen=True, eq=False)
class FlatField:
    """Strength of each light over the frame, relative to one value for all lights.

    Coordinates are from the middle of the frame, y up, in units of half of the longer side.
    """

    coefficients: Floats  # (N, T, T) of y^i x^j in the logarithm of the strength, T at most 7
    bounds: Floats  # (N, 2) lowest and highest logarithm, to which the polynomial is clipped

    def __post_init__(self) -> None:
        lights, *terms = self.coefficients.shape or (0,)
        if len(terms) != 2 or terms[0] != terms[1] or not 1 <= terms[0] <= TERMS:
            raise InputError(
                f"flat field of {self.coefficients.shape} coefficients; give (lights, T, T), T at "
                f"most {TERMS}"
            )
        if not np.isfinite(self.coefficients).all():
            raise InputError("a coefficient of the flat field is NaN or infinite; give numbers")
        if (
            self.bounds.shape != (lights, 2)
            or (self.bounds[:, 0] > self.bounds[:, 1]).any()
            or not (np.abs(self.bounds) <= _MAX_LOGARITHM).all()
        ):
            raise InputError(
                f"flat field with {self.bounds.shape} bounds, or bounds beyond "
                f"{_MAX_LOGARITHM:g} or in the wrong order; give the lowest and the highest "
                "logarithm of each light"
            )

    @property
    def largest_fall_off(self) -> float:
        """Largest relative fall-off of a light, from its brightest to its darkest point."""
        return float(1.0 - np.exp(self.bounds[:, 0] - self.bounds[:, 1]).min())

    def saturation(self, full_scale: float) -> np.float32:
        """Value of saturated pixels after `divide`; unsaturated ones stay below."""
        return np.float32(full_scale * np.exp(max(0.0, -self.bounds.min())))

    def strengths(self, rows: Indices, columns: Indices, shape: tuple[int, int]) -> Floats:
        """(N, m, n) strengths at the (m,) rows and (n,) columns of a frame of `shape`."""
        strengths: Floats = np.exp(self.logarithms(*coordinates(rows, columns, shape)))
        return strengths

    def logarithms(self, x: Floats, y: Floats) -> Floats:
        """(N, m, n) logarithms of the strengths at the (n,) `x` and (m,) `y` coordinates."""
        terms = self.coefficients.shape[1]
        logarithms = powers(y, terms) @ self.coefficients @ powers(x, terms).T
        low, high = self.bounds.T[..., None, None]
        return np.asarray(np.clip(logarithms, low, high), np.float64)

    @property
    def shared(self) -> "FlatField":
        """Vignetting and common fall-off: the geometric mean of all lights, for every light."""
        lights = len(self.coefficients)
        coefficients, bounds = (
            np.repeat(values.mean(axis=0, keepdims=True), lights, axis=0)
            for values in (self.coefficients, self.bounds)
        )
        return FlatField(coefficients, bounds)

    def without_cosines(self, lighting: Lighting) -> "FlatField":
        """Divide each light by its cosine of incidence; the geometric mean of all stays."""
        if len(self.coefficients) != len(lighting):
            raise InputError(
                f"the flat field has {len(self.coefficients)} lights, the images have "
                f"{len(lighting)}; give the flat field of these lights"
            )
        cosines = lighting.directions[:, 2]
        logarithms = np.log(np.exp(np.log(cosines).mean()) / cosines)
        coefficients = self.coefficients.copy()
        coefficients[:, 0, 0] += logarithms
        return FlatField(coefficients, self.bounds + logarithms[:, None])

    def divide(self, stack: ImageStack, full_scale: float | None) -> ImageStack:
        """Divide the images minus the ambient image by the strengths, and add it again, in float32.

        Pixels that reach `full_scale` get `saturation`.
        """
        return DividedStack(stack.images, stack.ambient, self, full_scale).materialised()


@dataclass(frozen=True, eq=False)
class DividedStack(ImageStack):
    """Raw images that are divided as by `FlatField.divide` when they are read."""

    flat_field: FlatField
    full_scale: float | None  # value of saturated pixels before division

    def materialised(self) -> ImageStack:
        images = np.empty(self.images.shape, np.float32)

        def write(first: int, last: int) -> None:
            images[:, first:last] = self.float_rows(first, last)[0]

        run_on_rows(write, self.shape)
        ambient = None if self.ambient is None else self.ambient.astype(np.float32)
        return ImageStack(images, ambient)

    def raw_at(self, pixels: Indices) -> FloatMap:
        raw = super().raw_at(pixels)
        _multiply_at(pixels, raw, self.dark_at(pixels), *self._division)
        return raw

    def float_rows(self, first: int, last: int) -> tuple[FloatMap, FloatMap]:
        block = np.empty((len(self.images), last - first, self.shape[1]), np.float32)
        dark = self.dark_rows if self.ambient is None else self.ambient[first:last]
        dark = dark.astype(np.float32)
        _multiply(first, self.images, dark, *self._division, block)
        return block, dark

    @cached_property
    def _division(self) -> tuple[Array, Array, Array, Array, np.float32, np.float32]:
        """Arguments of the kernels: reciprocal strengths, coordinates, and saturation."""
        field, (rows, columns) = self.flat_field, self.shape
        lights, terms, _ = field.coefficients.shape
        coefficients = np.zeros((lights, TERMS, TERMS), np.float32)
        coefficients[:, :terms, :terms] = -field.coefficients
        bounds = -field.bounds[:, ::-1].astype(np.float32)
        x, y = coordinates(np.arange(rows), np.arange(columns), self.shape)
        saturation = np.inf if self.full_scale is None else self.full_scale
        axes = x.astype(np.float32), y.astype(np.float32)
        return coefficients, bounds, *axes, np.float32(saturation), field.saturation(saturation)


_Row = tuple[np.float32, ...]  # coefficients of seven powers of x


@kernel
def exponential(e: np.float32) -> np.float32:
    """exp(e) as the Taylor polynomial of exp(e / 16), squared four times."""
    # Compilers vectorise it. The error is 2e-6 for |e| < 1, and 2e-4 for |e| < 4.
    one, half, third = np.float32(1.0), np.float32(1.0 / 2.0), np.float32(1.0 / 3.0)
    u = np.float32(1.0 / 16.0) * e
    root = one + u * (one + half * u * (one + third * u * (one + np.float32(1.0 / 4.0) * u)))
    root *= root
    root *= root
    root *= root
    return root * root


@kernel
def _multiply(
    first: int, images: Array, dark: Array, coefficients: Array, bounds: Array, x: Array, y: Array,
    saturation: np.float32, top: np.float32, product: Array,
) -> None:  # fmt: skip
    """Write `dark` + (images - `dark`) * factor to `product` (N, n, W), from row `first` on."""
    # The factor is exp of the polynomial with `coefficients` (N, 7, 7) of y^i x^j, clipped to
    # `bounds`. Pixels that reach `saturation` get the value `top`.
    lights, rows, columns = product.shape
    step = max(1, max(len(x), len(y)) // _INTERVALS)
    row_step_y = np.float32(-2.0 / max(len(x), len(y)))  # y of a row less that of the row above
    # The factor along a column in an interval: its value, slope and curvature.
    parabola = np.empty((3, columns), np.float32)
    for k in range(lights):
        low, high = bounds[k]
        min_factor, max_factor = exponential(low), exponential(high)
        interval = -1
        for r in range(rows):
            if (first + r) // step != interval:
                interval = (first + r) // step
                for n in range(3):
                    row_y = y[interval * step] + row_step_y * np.float32(0.5 * n * step)
                    _exponentials(_row(coefficients[k], row_y), low, high, x, parabola[n])
                for c in range(columns):
                    start, middle, end = parabola[0, c], parabola[1, c], parabola[2, c]
                    curvature = (start - middle) + (end - middle)
                    parabola[1, c] = end - start - (curvature + curvature)
                    parabola[2, c] = curvature + curvature
            share = np.float32((first + r) % step / step)
            dark_row = dark[min(r, len(dark) - 1)]
            for c in range(columns):
                factor = parabola[0, c] + share * (parabola[1, c] + share * parabola[2, c])
                factor = min(max(factor, min_factor), max_factor)
                raw = np.float32(images[k, first + r, c])
                value = dark_row[c] + (raw - dark_row[c]) * factor
                product[k, r, c] = value if raw < saturation else top


@kernel
def _multiply_at(
    pixels: Array, values: Array, dark: Array, coefficients: Array, bounds: Array, x: Array,
    y: Array, saturation: np.float32, top: np.float32,
) -> None:  # fmt: skip
    """As `_multiply`, for (N, n) values of the pixels with these flat indices, in place."""
    for k in range(len(values)):
        row, factors = -1, _row(coefficients[k], y[0])
        for n in range(len(pixels)):
            r, c = divmod(pixels[n], len(x))
            if r != row:
                row, factors = r, _row(coefficients[k], y[r])
            raw, dark_value = values[k, n], dark[min(n, len(dark) - 1)]
            factor = _factor(factors, bounds[k, 0], bounds[k, 1], x[c])
            value = dark_value + (raw - dark_value) * factor
            values[k, n] = value if raw < saturation else top


@kernel
def _row(coefficients: Array, y: np.float32) -> _Row:
    """Coefficients of powers of x in one row."""
    c0 = c1 = c2 = c3 = c4 = c5 = c6 = np.float32(0.0)
    for i in range(TERMS - 1, -1, -1):
        c = coefficients[i]
        c0, c1, c2, c3 = c0 * y + c[0], c1 * y + c[1], c2 * y + c[2], c3 * y + c[3]
        c4, c5, c6 = c4 * y + c[4], c5 * y + c[5], c6 * y + c[6]
    return c0, c1, c2, c3, c4, c5, c6


@kernel
def _exponentials(
    factors: _Row, low: np.float32, high: np.float32, x: Array, exponentials: Array
) -> None:
    """Write exp of a polynomial at all `x`, clipped to two bounds, to `exponentials`."""
    for c in range(len(x)):
        exponentials[c] = _factor(factors, low, high, x[c])


@kernel
def _factor(factors: _Row, low: np.float32, high: np.float32, x: np.float32) -> np.float32:
    c0, c1, c2, c3, c4, c5, c6 = factors
    e = c3 + x * (c4 + x * (c5 + x * c6))
    e = c0 + x * (c1 + x * (c2 + x * e))
    factor: np.float32 = exponential(min(max(e, low), high))
    return factor


def coordinates(rows: Array, columns: Array, shape: tuple[int, int]) -> tuple[Floats, Floats]:
    """X of columns and y of rows, relative to the middle, in half of the longer side."""
    x, y = columns - 0.5 * (shape[1] - 1), 0.5 * (shape[0] - 1) - rows
    return (2.0 / max(shape) * x).astype(float), (2.0 / max(shape) * y).astype(float)


def powers(values: Floats, terms: int) -> Floats:
    """(n, terms) powers 0, 1, 2, ... of n values."""
    return np.vander(values, terms, increasing=True)


def exponents(degree: int) -> tuple[Indices, Indices]:
    """Exponents i and j of the terms y^i x^j with i + j up to `degree`."""
    i, j = np.nonzero(np.add.outer(np.arange(degree + 1), np.arange(degree + 1)) <= degree)
    return i, j


FOLDS = 4
"""Cross-validation has 4 x 4 folds, each a part of the frame; one is left out at a time."""

# Ridge as a share of the trace of the normal equations. Without it, a narrow frame does not
# determine the powers of its short coordinate.
_RIDGE = 1e-6
_TINY = 1e-30  # makes all-zero normal equations solvable

TUKEY = 4.685
"""Tuning constant of Tukey's biweight, for 95 % efficiency at normal errors."""

MEDIAN_SQUARE = 0.4549
"""Median of the square of a standard normal deviate."""


def by_fold(blocks: Floats) -> Floats:
    """Regroup (..., n, n) blocks to (..., folds, blocks of a fold); n is a multiple of 4."""
    size = blocks.shape[-1] // FOLDS
    folds = blocks.reshape(*blocks.shape[:-2], FOLDS, size, FOLDS, size).swapaxes(-3, -2)
    return folds.reshape(*blocks.shape[:-2], FOLDS**2, size**2)


def folded_basis(x: Floats, y: Floats, degree: int) -> Floats:
    """(folds, blocks, terms) values of y^i x^j, as `exponents`, at blocks on a grid of x and y."""
    i, j = exponents(degree)
    x_powers, y_powers = powers(x, degree + 1).T, powers(y, degree + 1).T
    terms = by_fold(y_powers[i][:, :, None] * x_powers[j][:, None, :])
    return np.ascontiguousarray(np.moveaxis(terms, 0, -1))


@kernel
def normal_equations(basis: Array, means: Array, weights: Array) -> tuple[Array, Array]:
    """Gram matrices (folds, terms, terms) and right-hand sides (folds, terms, N)."""
    folds, blocks, terms = basis.shape
    gram, right = np.zeros((folds, terms, terms)), np.zeros((folds, terms, len(means)))
    for fold in range(folds):
        for block in range(blocks):
            row, weight = basis[fold, block], weights[fold, block]
            for i in range(terms):
                weighted = weight * row[i]
                for j in range(i + 1):
                    gram[fold, i, j] += weighted * row[j]
                for k in range(len(means)):
                    right[fold, i, k] += weighted * means[k, fold, block]
    return gram, right


@kernel
def solve_normal_equations(gram: Array, right: Array) -> Array:
    """(terms, N) coefficients from the lower half of normal equations, with a small ridge."""
    terms, lights = right.shape
    ridge = _RIDGE * np.trace(gram) + _TINY
    # Cholesky decomposition, with the right-hand sides as further rows.
    root = np.empty((terms + lights, terms))
    for i in range(terms + lights):
        for j in range(min(i + 1, terms)):
            reduced = gram[i, j] + (ridge if i == j else 0.0) if i < terms else right[j, i - terms]
            for m in range(j):
                reduced -= root[i, m] * root[j, m]
            root[i, j] = np.sqrt(reduced) if i == j else reduced / root[j, j]
    solution = np.empty_like(right)
    for i in range(terms - 1, -1, -1):
        for k in range(lights):
            reduced = root[terms + k, i]
            for m in range(i + 1, terms):
                reduced -= root[m, i] * solution[m, k]
            solution[i, k] = reduced / root[i, i]
    return solution


@kernel
def prediction_error(basis: Array, means: Array, weights: Array) -> float:
    """Weighted sum of squared errors of all folds, each predicted from the others."""
    gram, right = normal_equations(basis, means, weights)
    total_gram, total_right, error = gram.sum(axis=0), right.sum(axis=0), 0.0
    for fold in range(len(basis)):
        solution = solve_normal_equations(total_gram - gram[fold], total_right - right[fold])
        for block in range(basis.shape[1]):
            for k in range(len(means)):
                difference = means[k, fold, block]
                for i in range(len(solution)):
                    difference -= basis[fold, block, i] * solution[i, k]
                error += weights[fold, block] * difference * difference
    return error
