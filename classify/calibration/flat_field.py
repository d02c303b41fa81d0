"""Flat field of each light from light images of a white matt sheet."""

from dataclasses import dataclass

import numpy as np

from classify.base.arrays import Floats
from classify.lights.flat_field import (
    MEDIAN_SQUARE,
    TERMS,
    TUKEY,
    FlatField,
    by_fold,
    exponents,
    normal_equations,
    powers,
    prediction_error,
    solved,
)

from .plate_blocks import BLOCKS, PlateBlocks

# The degree is raised while the squared error of predicting left-out parts of the frame falls below
# this share; classify/DECISIONS.md has the errors of each degree.
_DEGREES, _BETTER = (2, 4, 6), 0.98
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
    covered = np.zeros((BLOCKS + 1, BLOCKS + 1), np.bool_)
    usable = blocks.usable.any(axis=0)
    for rows in (slice(None, -1), slice(1, None)):
        for columns in (slice(None, -1), slice(1, None)):
            covered[rows, columns] |= usable
    coefficients[:, 0, 0] -= (powers(blocks.y, TERMS) @ coefficients @ powers(blocks.x, TERMS).T)[
        :, usable
    ].mean()
    logs = (powers(y, TERMS) @ coefficients @ powers(x, TERMS).T)[:, covered]
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
    """Robust polynomials (C, 7, 7) of the values (S, C, 32, 32) of S placements."""

    coefficients: Floats
    degree: int
    residual: float
    error: float
    unused: float
    means: Floats
    weights: Floats
    offsets: Floats

    @classmethod
    def of(cls, values: Floats, blocks: PlateBlocks) -> "_Fit":
        targets, usable = by_fold(values), by_fold(blocks.usable.astype(float))
        bases = {degree: _basis(blocks, degree) for degree in _DEGREES}
        coefficients = np.zeros((values.shape[1], TERMS, TERMS))
        chosen = _DEGREES[0]
        coefficients = _refined(coefficients, chosen, bases[chosen], targets, usable)
        for degree in _DEGREES[1:]:
            fitted = _evaluated(coefficients, chosen, bases[chosen])
            means, weights, *_ = _combined(targets - fitted, usable)
            low, high = (prediction_error(bases[d], means, weights) for d in (chosen, degree))
            if high > _BETTER * low:
                break
            chosen = degree
            coefficients = _refined(coefficients, chosen, bases[chosen], targets, usable)
        fitted = _evaluated(coefficients, chosen, bases[chosen])
        means, weights, offsets, scale = _combined(targets - fitted, usable)
        counts = np.maximum(usable.sum(axis=0), 1.0)
        plain = ((targets - fitted - offsets[..., None, None]) * usable[:, None]).sum(
            axis=0
        ) / counts
        counted = float(weights.sum()) / max(float(weights.max()), _TINY)
        terms = bases[chosen].shape[-1]
        return cls(
            coefficients,
            chosen,
            scale,
            # 1 - _BETTER: a bias remains where the next degree is better, but not clearly.
            scale * float(np.sqrt(terms / max(counted, 1.0) + 1.0 - _BETTER)),
            1.0 - float((weights > 0.0).sum()) / max(float((usable.sum(axis=0) > 0).sum()), 1.0),
            _unfolded(fitted + np.where(weights > 0.0, means, plain)),
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
        refined[:, i, j] += solved(gram.sum(axis=0), right.sum(axis=0)).T
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
    """(..., 32, 32) blocks of the frame, from (..., folds, blocks of a fold)."""
    order = by_fold(np.arange(float(BLOCKS * BLOCKS)).reshape(BLOCKS, BLOCKS)).astype(int)
    placed = np.empty((*blocks.shape[:-2], BLOCKS * BLOCKS))
    placed[..., order] = blocks
    return placed.reshape(*blocks.shape[:-2], BLOCKS, BLOCKS)


def _basis(blocks: PlateBlocks, degree: int) -> Floats:
    """(folds, blocks, terms) values of y^i x^j."""
    i, j = exponents(degree)
    x, y = powers(blocks.x, TERMS), powers(blocks.y, TERMS)
    return np.moveaxis(by_fold(y.T[i][:, :, None] * x.T[j][:, None, :]), 0, -1)


def _edges(centres: Floats) -> Floats:
    half = 0.5 * (centres[1] - centres[0])
    return np.append(centres - half, centres[-1] + half)
