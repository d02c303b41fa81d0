"""Circles through points, and how well points determine them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from classify.base.arrays import Floats

_SECTORS = 8


class Circle(NamedTuple):
    """A circle: column and row of its centre, and radius, in pixels."""

    column: float
    row: float
    radius: float


def fitted_circle(points: Floats, weights: Floats, start: Circle) -> Circle:
    """Fit a circle to (n, 2) points by geometric distance (Gauss-Newton)."""
    column, row, radius = start
    root = np.sqrt(weights)
    for _ in range(4):
        dx, dy = points[:, 0] - column, points[:, 1] - row
        distance = np.hypot(dx, dy)
        design = np.stack([dx / distance, dy / distance, np.ones_like(distance)], axis=1)
        step = np.linalg.lstsq(design * root[:, None], (distance - radius) * root, rcond=None)[0]
        column, row, radius = column + step[0], row + step[1], radius + step[2]
    return Circle(float(column), float(row), float(radius))


def centre_error(rim: Floats, weights: Floats, circle: Circle) -> float:
    """Standard error of the centre, from fits that leave out one sector each.

    Errors of an outline are correlated over long arcs, so the scatter of its points is too small.
    """
    angles = np.arctan2(rim[:, 1] - circle.row, rim[:, 0] - circle.column)
    sector = np.floor((angles / (2.0 * np.pi) + 0.5) * _SECTORS).astype(int) % _SECTORS
    fits = np.array([
        fitted_circle(rim[sector != k], weights[sector != k], circle)[:2]
        for k in range(_SECTORS)
    ])  # fmt: skip
    variance = (_SECTORS - 1) * fits.var(axis=0)
    return float(np.sqrt(variance.max()))


def circles_through(points: Floats) -> Floats:
    """Circles (n, 3) through (n, 3, 2) points; not finite for three in a line."""
    first = points[:, 0]
    a, b = points[:, 1] - first, points[:, 2] - first
    cross = 2.0 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    aa, bb = (a**2).sum(axis=1), (b**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (b[:, 1] * aa - a[:, 1] * bb) / cross
        y = (a[:, 0] * bb - b[:, 0] * aa) / cross
    return np.stack([first[:, 0] + x, first[:, 1] + y, np.hypot(x, y)], axis=1)
