"""Fit circles to points, with errors, and detect circles by a Hough transform."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy import ndimage

from classify.base.arrays import BoolArray, FloatMap, Floats

# Starts that are off by 5 % of the radius come within 1e-8 px of the minimum.
_GAUSS_NEWTON_STEPS = 4
_SECTORS = 8  # of the jackknife


class Circle(NamedTuple):
    """A circle: column and row of its centre, and radius, in pixels."""

    column: float
    row: float
    radius: float


def fitted_circle(points: Floats, weights: Floats, start: Circle) -> Circle:
    """Fit a circle to (n, 2) points by geometric distance (Gauss-Newton)."""
    column, row, radius = start
    root = np.sqrt(weights)
    for _ in range(_GAUSS_NEWTON_STEPS):
        dx, dy = points[:, 0] - column, points[:, 1] - row
        distance = np.hypot(dx, dy)
        design = np.stack([dx / distance, dy / distance, np.ones_like(distance)], axis=1)
        step = np.linalg.lstsq(design * root[:, None], (distance - radius) * root, rcond=None)[0]
        column, row, radius = column + step[0], row + step[1], radius + step[2]
    return Circle(float(column), float(row), float(radius))


def jackknife_variances(x: Floats, y: Floats, fit: Callable[[BoolArray], npt.ArrayLike]) -> Floats:
    """Jackknife variances of the numbers that `fit` returns for a selection of (n,) points.

    Each fit leaves out one of eight sectors around the origin.
    """
    angles = np.arctan2(y, x)
    sector = np.floor((angles / (2.0 * np.pi) + 0.5) * _SECTORS).astype(int) % _SECTORS
    fits = np.array([fit(sector != left_out) for left_out in range(_SECTORS)])
    return np.asarray((_SECTORS - 1) * fits.var(axis=0))


def centre_error(points: Floats, weights: Floats, circle: Circle) -> float:
    """Standard error of the centre of a circle that was fitted to (n, 2) points."""
    x, y = points.T
    variances = jackknife_variances(
        x - circle.column,
        y - circle.row,
        lambda used: fitted_circle(points[used], weights[used], circle)[:2],
    )
    return float(np.sqrt(variances.max()))


def circles_through(points: Floats) -> Floats:
    """Circumcircles (n, 3) of (n, 3, 2) points; not finite for three in a line."""
    first = points[:, 0]
    a, b = points[:, 1] - first, points[:, 2] - first
    cross = 2.0 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    aa, bb = (a**2).sum(axis=1), (b**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (b[:, 1] * aa - a[:, 1] * bb) / cross
        y = (a[:, 0] * bb - b[:, 0] * aa) / cross
    return np.stack([first[:, 0] + x, first[:, 1] + y, np.hypot(x, y)], axis=1)


# Standard deviation of the angle between a gradient and the direction to the centre.
_VOTE_SCATTER_RAD = 0.05
# Ratio of neighbouring radii: half a step is within the scatter of the votes.
_RADIUS_STEP = 1.05
# Number of detected circles: the time of `sphere_outline` is proportional to it.
_CANDIDATES = 12
_MIN_RADIUS_PX = 8.0
# Largest radius as a share of the shorter side of the image; a circle of 0.5 just fits in.
_MAX_RADIUS_SHARE = 0.55
# Width of the Gaussian that gives the expected votes, over that of the counted ones.
_BACKGROUND_RATIO = 4.0
# Least variance of a count of votes, as a share of the radius in pixels.
_VARIANCE_FLOOR = 0.2
# Circles are duplicates if their centres and radii differ by less than this share of the radius.
_DUPLICATE_SHARE = 0.1
# Gradients over the median gradient of the image: the least at an edge, and that of weight 0.5.
_MIN_EDGE, _HALF_WEIGHT = 2.0, 4.0


def voted_circles(images: Sequence[FloatMap], smallest_radius_px: float) -> list[Circle]:
    """Detect circles in (H, W) images, the likeliest first.

    A Hough transform with votes along gradients (Kimme, Ballard and Sklansky 1975).
    """
    points, gradients, weights = _edges(images)
    height, width = images[0].shape
    candidates: list[tuple[float, Circle]] = []
    radius = max(smallest_radius_px, _MIN_RADIUS_PX)
    while radius <= _MAX_RADIUS_SHARE * min(height, width):
        votes = np.zeros(height * width)
        for sign in (-radius, radius):
            centres = np.rint(points + sign * gradients).astype(np.intp)
            inside = ((centres >= 0) & (centres < (width, height))).all(axis=1)
            cell = centres[inside, 1] * width + centres[inside, 0]
            votes += np.bincount(cell, weights[inside], height * width)
        scatter = max(1.0, _VOTE_SCATTER_RAD * radius)
        accumulator = votes.reshape(height, width)
        # The effective area of a Gaussian turns a weighted mean into a count.
        area = 4.0 * np.pi * scatter**2
        count = cv2.GaussianBlur(accumulator, (0, 0), scatter) * area
        expected = cv2.GaussianBlur(accumulator, (0, 0), _BACKGROUND_RATIO * scatter) * area
        # Excess over edges in random places, in standard deviations (Poisson, with a floor).
        score = (count - expected) / np.sqrt(expected + _VARIANCE_FLOOR * radius)
        peaks = (score == cv2.dilate(score, np.ones((5, 5)))) & (score > 0.0)
        candidates += [
            (float(score[row, column]), Circle(float(column), float(row), radius))
            for row, column in np.argwhere(peaks)
        ]
        radius *= _RADIUS_STEP
    candidates.sort(key=lambda candidate: -candidate[0])
    # Suppress duplicates of better circles.
    distinct: list[Circle] = []
    for _, circle in candidates:
        if all(
            np.hypot(circle.column - other.column, circle.row - other.row)
            + abs(circle.radius - other.radius) > _DUPLICATE_SHARE * circle.radius
            for other in distinct
        ):  # fmt: skip
            distinct.append(circle)
            if len(distinct) == _CANDIDATES:
                break
    return distinct


def _edges(images: Sequence[FloatMap]) -> tuple[Floats, Floats, Floats]:
    """Columns and rows (n, 2), unit gradients (n, 2), weights (n,) of maxima of the gradient."""
    edges_by_image = []
    for image in images:
        smooth = cv2.GaussianBlur(image, (0, 0), 1.0)
        gx, gy = (cv2.Scharr(smooth, cv2.CV_32F, dx, 1 - dx) for dx in (1, 0))
        magnitude = np.hypot(gx, gy)
        typical = float(np.median(magnitude)) + 1e-6
        rows, columns = np.nonzero(magnitude > _MIN_EDGE * typical)
        strength = magnitude[rows, columns]
        ux, uy = gx[rows, columns] / strength, gy[rows, columns] / strength
        # Non-maximum suppression along the gradient (Canny 1986).
        before, after = (
            ndimage.map_coordinates(
                magnitude, (rows + k * uy, columns + k * ux), order=1, mode="nearest"
            )
            for k in (-1, 1)
        )
        weight = strength / (strength + _HALF_WEIGHT * typical)
        edges = np.stack([columns, rows, ux, uy, weight], axis=1)
        edges_by_image.append(edges[(strength >= before) & (strength > after)])
    edges = np.concatenate(edges_by_image).astype(np.float64)
    return edges[:, :2], edges[:, 2:4], edges[:, 4]
