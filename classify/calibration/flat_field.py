"""Flat field of each light from light images of a white matt sheet."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from classify.base.arrays import Array, BoolArray, FloatMap, Floats
from classify.base.errors import InputError
from classify.images import SIGMA_PER_MAD, ImageStack
from classify.lights.flat_field import (
    MEDIAN_SQUARE,
    TERMS,
    TUKEY,
    FlatField,
    by_fold,
    coordinates,
    exponents,
    folded_basis,
    normal_equations,
    powers,
    prediction_error,
    solve_normal_equations,
)

# Number of blocks along each side of the frame, and largest number of cells along that of a block.
# Within a block the light of LEDs at two fields of view departs from a plane by 0.01 %.
_BLOCKS, _MAX_CELLS = 32, 16
# Cells further from the median of their block than this multiple of its robust standard deviation
# are dust.
_DUST_DEVIATIONS = 4.0
# Cells darker than this share of the bright ones are beside the sheet, as in `fall_off`.
_MIN_BRIGHTNESS = 0.05
# Share of the cells of a block that must be usable for the block to count.
_MIN_USABLE_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class PlateBlocks:
    """Blocks of S placements of a sheet under N lights."""

    logs: Floats  # (S, N, 32, 32) of the mean values less ambient light; 0 where not `usable`
    usable: BoolArray  # (S, 32, 32), false where too much is outside the mask or saturated
    relief: Floats  # (S, 32, 32) robust scatter in a block of a light's ratio to the mean
    saturated: Floats  # (S, N) share of pixels within the mask
    levels: Floats  # (S, N) median less ambient light, as a share of full scale
    x: Floats  # (32,) in half of the longer side
    y: Floats  # (32,) in half of the longer side, upwards
    shape: tuple[int, int]  # rows and columns of the frame

    @classmethod
    def of(
        cls, placements: Sequence[ImageStack], full_scale: float, mask: BoolArray | None = None
    ) -> "PlateBlocks":
        """Blocks of the placements; only pixels of the (H, W) `mask` count."""
        shape = placements[0].shape
        maps = (_of_placement(placement, full_scale, mask) for placement in placements)
        rows, columns = ((np.arange(_BLOCKS) + 0.5) * length / _BLOCKS - 0.5 for length in shape)
        x, y = coordinates(rows, columns, shape)
        logs, usable, relief, saturated, levels = map(np.stack, zip(*maps, strict=True))
        return cls(logs, usable, relief, saturated, levels, x, y, shape)

    @property
    def ratios(self) -> Floats:
        """(S, N, 32, 32) log ratios of each light to the geometric mean of all."""
        ratios: Floats = self.logs - self.logs.mean(axis=1, keepdims=True)
        return ratios


def _of_placement(
    stack: ImageStack, full_scale: float, mask: BoolArray | None
) -> tuple[Array, ...]:
    """The first five fields of `PlateBlocks`, from logs to levels, without the axis S."""
    rows, columns = (_BLOCKS * min(max(side // _BLOCKS, 1), _MAX_CELLS) for side in stack.shape)
    cells = (rows, columns)
    ambient = np.float32(0.0) if stack.ambient is None else stack.ambient.astype(np.float32)
    sheet = np.ones(stack.shape, np.bool_) if mask is None else mask
    saturated = stack.images >= full_scale
    good = _in_blocks(_resized(sheet & ~saturated.any(axis=0), cells)) > 1.0 - 1e-3
    values = np.stack(
        [_in_blocks(_resized(image - ambient, cells)) for image in stack.images]
    ).astype(np.float64)
    brightness = values.mean(axis=0)
    good &= (values > 0.0).all(axis=0) & (
        brightness > _MIN_BRIGHTNESS * np.percentile(brightness, 95)
    )
    logs = np.log(np.where(good, values, 1.0))
    common = logs.mean(axis=0)
    ratio = logs - common
    ratio_deviations = _deviation(ratio, good)
    ratio_scatter = np.nan_to_num(_median(np.abs(ratio_deviations)))
    relief = SIGMA_PER_MAD * np.sqrt(np.square(ratio_scatter).mean(axis=0))
    common_deviations = _deviation(common, good)
    grain = SIGMA_PER_MAD * np.nan_to_num(_median(np.abs(common_deviations)))
    clean = good & (np.abs(common_deviations) <= _DUST_DEVIATIONS * grain[..., None] + 1e-9)
    for light in ratio_deviations:
        spread = SIGMA_PER_MAD * np.nan_to_num(_median(np.abs(light)))[..., None]
        clean &= np.abs(light) <= _DUST_DEVIATIONS * spread + 1e-9
    count = clean.sum(axis=-1)
    means = (values * clean).sum(axis=-1) / np.maximum(count, 1)
    usable = count >= _MIN_USABLE_SHARE * clean.shape[-1]
    sheet_px = max(int(sheet.sum()), 1)
    return (
        np.where(usable, np.log(np.where(usable, means, 1.0)), 0.0),
        usable,
        relief,
        (saturated & sheet).sum(axis=(1, 2)) / sheet_px,
        np.array([np.median(light[good]) if good.any() else 0.0 for light in values]) / full_scale,
    )


def _resized(image: Array, cells: tuple[int, int]) -> FloatMap:
    """Means of the image over (rows, columns) cells."""
    size = (cells[1], cells[0])
    resized = cv2.resize(image.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(resized, np.float32)


def _in_blocks(cells: FloatMap) -> FloatMap:
    """(32, 32, n) the n cells of each block."""
    rows, columns = (length // _BLOCKS for length in cells.shape)
    blocks = cells.reshape(_BLOCKS, rows, _BLOCKS, columns).swapaxes(1, 2)
    return blocks.reshape(_BLOCKS, _BLOCKS, rows * columns)


def _deviation(values: Floats, good: BoolArray) -> Floats:
    """Differences of good cells from the median of their block; NaN for the others."""
    masked = np.where(good, values, np.nan)
    deviation: Floats = masked - _median(masked)[..., None]
    return deviation


def _median(values: Floats) -> Floats:
    """Lower median over the cells of each block without NaN; NaN for a block without any."""
    ordered = np.sort(values, axis=-1)  # NaN last
    count = np.isfinite(ordered).sum(axis=-1)
    middle = np.maximum(count - 1, 0) // 2
    medians: Floats = np.take_along_axis(ordered, middle[..., None], axis=-1)[..., 0]
    return medians


# Correlation of the grain of two placements above which a sheet was not moved between them. On the
# rendered sheets of test_plate.py without dust it is at most 0.09 after a rotation; without one, at
# a grain of 0.5 %, at least 0.73. On an even sheet it is lost in the noise. The pattern of the
# sensor does not rotate with the sheet, but is weaker.
_SAME_GRAIN_CORRELATION = 0.7


def check_placements_differ(images: Sequence[Array]) -> None:
    """Refuse placements with the same light images: their errors are the same."""
    numbered = enumerate(images, start=1)
    for (first, first_images), (second, second_images) in combinations(numbered, 2):
        if np.array_equal(first_images, second_images):
            raise InputError(
                f"placements {first} and {second} have the same light images; rotate or move the "
                "target between them, or give them once"
            )


def are_moved(blocks: PlateBlocks, flat_field: FlatField) -> bool:
    """Whether the sheet was rotated or moved between any two placements, by its grain and dust."""
    y, x = powers(blocks.y, TERMS), powers(blocks.x, TERMS)
    uneven = blocks.logs.mean(axis=1) - y @ flat_field.coefficients.mean(axis=0) @ x.T
    # Subtract the mean of the four neighbours, and with it a smooth bias of the polynomial.
    grain, usable = uneven[:, 1:-1, 1:-1].copy(), blocks.usable[:, 1:-1, 1:-1].copy()
    for rows, columns in ((0, 1), (2, 1), (1, 0), (1, 2)):
        neighbour = np.s_[:, rows : rows + grain.shape[1], columns : columns + grain.shape[2]]
        grain -= 0.25 * uneven[neighbour]
        usable &= blocks.usable[neighbour]
    for first, second in combinations(range(len(grain)), 2):
        both_usable = usable[first] & usable[second]
        a, b = grain[first][both_usable], grain[second][both_usable]
        if a @ b <= _SAME_GRAIN_CORRELATION * np.linalg.norm(a) * np.linalg.norm(b):
            return True
    return False


# The degree of the polynomials is raised while the squared error of predicting left-out parts of
# the frame falls below this share of that of the lower degree (cross-validation).
# classify/DECISIONS.md has the errors of each degree.
_DEGREES, _MAX_ERROR_SHARE = (2, 4, 6), 0.98
_ROUNDS = 12
_TINY = 1e-30


@dataclass(frozen=True, eq=False)
class FittedFlatField:
    """A flat field and how well it fits the blocks of its sheet in S placements."""

    flat_field: FlatField  # of geometric mean 1 over the lights and the blocks that were used
    degree: tuple[int, int]  # of the polynomials of the lights' ratios, and of their mean
    ratio_residual: float  # robust standard deviation, a share; relief and gloss raise it
    mean_residual: float  # likewise of the lights' mean; uneven reflectance raises it
    error: float  # standard error of the flat field by the residuals, a share
    unused: float  # share of the blocks that do not fit: dust, relief or gloss
    ratios: Floats  # (N, 32, 32) log ratio of each light to the geometric mean of all
    weights: Floats  # (32, 32) of the ratios; 0 where a block is not used
    offsets: Floats  # (S, N) log brightness, less the mean over the placements


def fit_flat_field(blocks: PlateBlocks) -> FittedFlatField:
    """Fit polynomials to the logarithms of the blocks: to the lights' ratios, and their mean."""
    common = blocks.logs.mean(axis=1, keepdims=True)
    ratio, mean = (_Fit.of(values, blocks) for values in (blocks.logs - common, common))
    coefficients = ratio.coefficients + mean.coefficients
    x, y = (_edges(centres) for centres in (blocks.x, blocks.y))
    usable = blocks.usable.any(axis=0)
    is_corner = np.zeros((_BLOCKS + 1, _BLOCKS + 1), np.bool_)  # of a usable block
    for rows in (slice(None, -1), slice(1, None)):
        for columns in (slice(None, -1), slice(1, None)):
            is_corner[rows, columns] |= usable
    # Geometric mean 1 over the lights and the usable blocks.
    centre_logs = powers(blocks.y, TERMS) @ coefficients @ powers(blocks.x, TERMS).T
    coefficients[:, 0, 0] -= centre_logs[:, usable].mean()
    logs = (powers(y, TERMS) @ coefficients @ powers(x, TERMS).T)[:, is_corner]
    return FittedFlatField(
        FlatField(coefficients, np.stack([logs.min(axis=1), logs.max(axis=1)], axis=1)),
        (ratio.degree, mean.degree),
        ratio.residual,
        mean.residual,
        float(np.hypot(ratio.error, mean.error)),
        max(ratio.unused, mean.unused),
        ratio.means,
        ratio.weights,
        ratio.offsets,
    )


@dataclass(frozen=True, eq=False)
class _Fit:
    """Robust polynomials of the values (S, C, 32, 32) of S placements."""

    coefficients: Floats  # (C, 7, 7)
    degree: int
    residual: float  # robust standard deviation
    error: float  # standard error of the polynomials
    unused: float  # share of the blocks with weight 0
    means: Floats  # (C, 32, 32) of the placements
    weights: Floats  # (32, 32)
    offsets: Floats  # (S, C) of the placements from their mean

    @classmethod
    def of(cls, values: Floats, blocks: PlateBlocks) -> "_Fit":
        targets, usable = by_fold(values), by_fold(blocks.usable.astype(float))
        bases = {degree: folded_basis(blocks.x, blocks.y, degree) for degree in _DEGREES}
        coefficients = np.zeros((values.shape[1], TERMS, TERMS))
        degree = _DEGREES[0]
        coefficients = _refined(coefficients, degree, bases[degree], targets, usable)
        for higher in _DEGREES[1:]:
            fitted = _evaluated(coefficients, degree, bases[degree])
            means, weights, *_ = _combined(targets - fitted, usable)
            error = prediction_error(bases[degree], means, weights)
            if prediction_error(bases[higher], means, weights) > _MAX_ERROR_SHARE * error:
                break
            degree = higher
            coefficients = _refined(coefficients, degree, bases[degree], targets, usable)
        fitted = _evaluated(coefficients, degree, bases[degree])
        means, weights, offsets, scale = _combined(targets - fitted, usable)
        counts = np.maximum(usable.sum(axis=0), 1.0)
        residuals = targets - fitted - offsets[..., None, None]
        unweighted_means = (residuals * usable[:, None]).sum(axis=0) / counts
        effective_blocks = float(weights.sum()) / max(float(weights.max()), _TINY)
        variance_share = bases[degree].shape[-1] / max(effective_blocks, 1.0)
        # A higher degree would have reduced the squared error by less than this.
        bias_share = 1.0 - _MAX_ERROR_SHARE
        return cls(
            coefficients,
            degree,
            scale,
            scale * float(np.sqrt(variance_share + bias_share)),
            1.0 - float((weights > 0.0).sum()) / max(float((usable.sum(axis=0) > 0).sum()), 1.0),
            _unfolded(fitted + np.where(weights > 0.0, means, unweighted_means)),
            _unfolded(weights),
            offsets,
        )


def _refined(
    coefficients: Floats,
    degree: int,
    basis: Floats,
    targets: Floats,
    usable: Floats,
) -> Floats:
    """Coefficients after repeated weighted least squares."""
    refined = coefficients.copy()
    i, j = exponents(degree)
    for _ in range(_ROUNDS):
        means, weights, *_ = _combined(targets - _evaluated(refined, degree, basis), usable)
        gram, right = normal_equations(basis, means, weights)
        refined[:, i, j] += solve_normal_equations(gram.sum(axis=0), right.sum(axis=0)).T
    return refined


def _evaluated(coefficients: Floats, degree: int, basis: Floats) -> Floats:
    """(C, folds, blocks) values of the polynomials."""
    i, j = exponents(degree)
    return np.moveaxis(basis @ coefficients[:, i, j].T, -1, 0)


def _combined(residuals: Floats, usable: Floats) -> tuple[Floats, Floats, Floats, float]:
    """Robust means (C, folds, blocks) over the placements, weights, offsets and scale."""
    offsets = np.zeros(residuals.shape[:2])
    weights = usable
    for _ in range(2):
        total = np.maximum(weights.sum(axis=(-1, -2)), _TINY)[:, None]
        offsets = (residuals * weights[:, None]).sum(axis=(-1, -2)) / total
        offsets -= offsets.mean(axis=0)
        squares = np.square(residuals - offsets[..., None, None]).mean(axis=1)
        used = squares[usable > 0.0]
        variance = float(np.median(used)) / MEDIAN_SQUARE if used.size else _TINY
        limit = max(TUKEY**2 * variance, _TINY)
        weights = np.square(np.maximum(1.0 - squares / limit, 0.0)) * usable
    totals = weights.sum(axis=0)
    means = ((residuals - offsets[..., None, None]) * weights[:, None]).sum(axis=0)
    return means / np.maximum(totals, _TINY), totals, offsets, float(np.sqrt(variance))


def _unfolded(blocks: Floats) -> Floats:
    """(..., 32, 32) blocks of the frame, from (..., folds, blocks of a fold) of `by_fold`."""
    order = by_fold(np.arange(float(_BLOCKS * _BLOCKS)).reshape(_BLOCKS, _BLOCKS)).astype(int)
    placed = np.empty((*blocks.shape[:-2], _BLOCKS * _BLOCKS))
    placed[..., order] = blocks
    return placed.reshape(*blocks.shape[:-2], _BLOCKS, _BLOCKS)


def _edges(centres: Floats) -> Floats:
    """Coordinates of the edges between blocks, and of the outer ones."""
    half = 0.5 * (centres[1] - centres[0])
    return np.append(centres - half, centres[-1] + half)
