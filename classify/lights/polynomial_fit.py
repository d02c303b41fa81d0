"""Weighted fit of polynomials to blocks of a frame, and its error of prediction."""

import numpy as np

from classify.base.arrays import Floats

# Folds of the cross-validation along each side of the frame; one is left out at a time.
_FOLDS = 4
# Share of the trace that is added to the diagonal of the normal equations: a narrow frame does not
# determine the powers of one coordinate.
_RIDGE = 1e-6
_TINY = 1e-30

TUKEY = 4.685
"""With this constant Tukey's biweight has 95 % of the efficiency of least squares."""

MEDIAN_SQUARE = 0.4549
"""Median of the square of a standard normal deviate."""


def by_fold(blocks: Floats) -> Floats:
    """(..., n, n) blocks as (..., folds, blocks of a fold); n is a multiple of 4."""
    size = blocks.shape[-1] // _FOLDS
    folds = blocks.reshape(*blocks.shape[:-2], _FOLDS, size, _FOLDS, size).swapaxes(-3, -2)
    return folds.reshape(*blocks.shape[:-2], _FOLDS**2, size**2)


def normal_equations(basis: Floats, means: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Gram matrices (folds, terms, terms) and right sides (folds, terms, N)."""
    weighted = (basis * weights[..., None]).swapaxes(1, 2)
    return weighted @ basis, weighted @ np.moveaxis(means, 0, -1)


def solved(gram: Floats, right: Floats) -> Floats:
    """(..., terms, N) coefficients from normal equations, with a small ridge."""
    terms = gram.shape[-1]
    ridge = _RIDGE * np.trace(gram, axis1=-2, axis2=-1)[..., None, None] + _TINY
    return np.asarray(np.linalg.solve(gram + ridge * np.eye(terms), right), np.float64)


def prediction_error(basis: Floats, means: Floats, weights: Floats) -> float:
    """Weighted sum of squared errors of all folds, each predicted from the others."""
    gram, right = normal_equations(basis, means, weights)
    predicted = basis @ solved(gram.sum(axis=0) - gram, right.sum(axis=0) - right)
    return float((np.square(np.moveaxis(means, 0, -1) - predicted) * weights[..., None]).sum())
