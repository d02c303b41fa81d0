"""Circles that edges vote for, by their gradients (after Duda and Hart 1972)."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from scipy import ndimage

from classify.base.arrays import FloatMap, Floats

from .circle import Circle

# Gradients point to the centre within about this angle, in radians.
_VOTE_SCATTER = 0.05
# Ratio of neighbouring radii: half a step is within the scatter of the votes.
_RADIUS_STEP = 1.05
# Circles that `sphere_outline` compares; the time of the search is proportional to it.
_CANDIDATES = 12


def voted_circles(images: Sequence[FloatMap], smallest_radius_px: float) -> list[Circle]:
    """Return circles in (H, W) images that many edges are on, the likeliest first."""
    points, gradients, weights = _edges(images)
    height, width = images[0].shape
    found: list[tuple[float, Circle]] = []
    radius = max(smallest_radius_px, 8.0)
    while radius <= 0.55 * min(height, width):
        votes = np.zeros(height * width)
        for sign in (-radius, radius):
            at = np.rint(points + sign * gradients).astype(np.intp)
            inside = ((at >= 0) & (at < (width, height))).all(axis=1)
            cell = at[inside, 1] * width + at[inside, 0]
            votes += np.bincount(cell, weights[inside], height * width)
        scatter = max(1.0, _VOTE_SCATTER * radius)
        image = votes.reshape(height, width)
        area = 4.0 * np.pi * scatter**2
        count = cv2.GaussianBlur(image, (0, 0), scatter) * area
        expected = cv2.GaussianBlur(image, (0, 0), 4.0 * scatter) * area
        # Standard deviations above what edges in random places give.
        score = (count - expected) / np.sqrt(expected + 0.2 * radius)
        peaks = (score == cv2.dilate(score, np.ones((5, 5)))) & (score > 0.0)
        found += [
            (float(score[row, column]), Circle(float(column), float(row), radius))
            for row, column in np.argwhere(peaks)
        ]
        radius *= _RADIUS_STEP
    found.sort(key=lambda each: -each[0])
    kept: list[Circle] = []
    for _, each in found:
        if all(
            np.hypot(each.column - other.column, each.row - other.row)
            + abs(each.radius - other.radius) > 0.1 * each.radius
            for other in kept
        ):  # fmt: skip
            kept.append(each)
            if len(kept) == _CANDIDATES:
                break
    return kept


def _edges(images: Sequence[FloatMap]) -> tuple[Floats, Floats, Floats]:
    """(n, 2) columns and rows, unit gradients, and (n,) weights of edge pixels."""
    found = []
    for image in images:
        smooth = cv2.GaussianBlur(image, (0, 0), 1.0)
        gx, gy = (cv2.Scharr(smooth, cv2.CV_32F, dx, 1 - dx) for dx in (1, 0))
        size = np.hypot(gx, gy)
        typical = float(np.median(size)) + 1e-6
        rows, columns = np.nonzero(size > 2.0 * typical)
        here = size[rows, columns]
        ux, uy = gx[rows, columns] / here, gy[rows, columns] / here
        before, after = (
            ndimage.map_coordinates(
                size, (rows + k * uy, columns + k * ux), order=1, mode="nearest"
            )
            for k in (-1, 1)
        )
        weight = here / (here + 4.0 * typical)
        edges = np.stack([columns, rows, ux, uy, weight], axis=1)
        found.append(edges[(here >= before) & (here > after)])
    edges = np.concatenate(found).astype(np.float64)
    return edges[:, :2], edges[:, 2:4], edges[:, 4]
