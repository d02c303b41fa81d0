"""Find the sphere in light images of it: its outline, to a fraction of a pixel.

Circles that edges vote for (`circle.voted_circles`) are compared by the edges on them, ray by ray.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from scipy import ndimage

from classify.base.arrays import Array, BoolArray, FloatMap, Floats
from classify.base.errors import CalibrationRejected

from .circle import Circle, centre_error, circles_through, fitted_circle, voted_circles

# The search reduces frames to this longer side, the last fit reduces spheres to this radius: 0.1 px
# is then 0.03 degrees of a normal.
_SEARCH_PX, _FIT_RADIUS_PX = 320, 200.0
# At 12 px an outline known to 0.2 px gives lights to 2 degrees.
_MIN_RADIUS_PX = 12.0
# Candidates that are fitted, rays from the centre, sectors of a score, edges kept on a ray, and
# random circles of each fit. More take more time; sphere_rates.py prints the errors.
_FINALISTS = 5
_RAYS, _SECTORS, _EDGES_PER_RAY = 240, 8, 5
_TRIALS = 240


class _Round(NamedTuple):
    """One round of the fit of an outline."""

    band: float  # half width of the band of radii in which edges are searched, share of the radius
    tolerance: float  # distance of an edge from the circle, share of the radius
    min_tolerance_px: float


_COARSE, _FINE = (_Round(0.15, 0.01, 1.0), _Round(0.08, 0.01, 1.0)), (_Round(0.05, 0.005, 0.5),)
# Rooms rendered without a sphere give 0 to 0.2, spheres in them 0.07 to 1
# (tests/sphere_pictures.py). A later step refuses circles without the highlight or the shading of a
# sphere.
_MIN_SCORE = 0.05
# At the finer scale wrong outlines of sphere_rates.py had 0.02 and 0.03, right ones 0.05 to 1.
_MIN_FINE_SCORE = 0.04
# Added to shares of full scale, so that noise of one digit in a black background is no edge.
_BLACK_OFFSET = 0.02
# Least number of lights for a ratio: the brightest is left out, and two remain.
_RATIO_LIGHTS = 3
# Systematic error of an outline from edges: 0.2 px, and this share of the radius, divided by the
# score. A mirror reflects its background in its rim, so that the outermost visible edge is inside
# the outline (40 spheres of tests/sphere_pictures.py in four kinds of background).
_SYSTEMATIC_PX, _SYSTEMATIC_SHARE = 0.2, 0.002
# A circle around the best one is the outline if it has this share of its score: windows and lamps
# in a mirror are small circles too.
_OUTER_SHARE, _OUTER_RADIUS = 0.4, 1.5
# A larger circle with the same centre, to this share of its radius, is the outline too: a mirror
# shows the edge of the ground as a circle of 0.75 to 0.9 of its radius (tests/capture/procedures).
_SAME_CENTRE, _LARGER = 0.02, 1.05
# A circle of about the same radius with this share of the score may be the outline as well. Of 96
# rendered mirrors (tests/sphere_pictures.py, four kinds of background) the two whose circle is off
# by more than 0.05 of the radius have such a rival, and nine in ten of the others have none.
_RIVAL_SHARE, _RIVAL_RADIUS = 0.85, 1.3
# rms deviation of a mask from a circle, as a share of the radius. Perspective gives 0.01 at 15
# degrees from the axis, a square 0.08.
_MAX_ROUNDNESS_ERROR = 0.02
# Error of masks in whole pixels: the rounding of circles of 60 to 200 px across.
_MASK_PX = 0.1
# Share of the circumference that may be beyond the frame.
_MAX_CUT_SHARE = 0.01


@dataclass(frozen=True, eq=False)
class Outline:
    """The outline of a sphere in a light image."""

    circle: Circle  # best fit
    rim: Floats  # (n, 2) columns and rows of points on it
    error_px: float  # standard error of the circle's centre
    score: float  # visible share of the circumference, 0 to 1; 1 for a mask


def outline_of_mask(mask: BoolArray) -> Outline:
    """Return the outline of the largest white region of an (H, W) mask of the sphere."""
    labels, count = ndimage.label(ndimage.binary_fill_holes(mask))
    sizes = np.bincount(labels.ravel(), minlength=2)
    sizes[0] = 0
    region = labels == np.argmax(sizes) if count else np.zeros_like(mask)
    rows, columns = np.nonzero(region)
    radius = float(np.sqrt(rows.size / np.pi))
    if radius < _MIN_RADIUS_PX:
        raise CalibrationRejected(
            f"the sphere in the mask has {2 * radius:.0f} px across; show it with at least "
            f"{2 * _MIN_RADIUS_PX:.0f} px"
        )
    height, width = mask.shape
    if (
        rows.min() == 0
        or columns.min() == 0
        or rows.max() == height - 1
        or columns.max() == width - 1
    ):
        raise CalibrationRejected(
            "the sphere in the mask is cut by the frame; show the whole of it"
        )
    # The middle between a white pixel and its black neighbour, along rows and along columns.
    rim = np.concatenate([
        np.argwhere(region[:, 1:] != region[:, :-1])[:, ::-1] + (0.5, 0.0),
        np.argwhere(region[1:] != region[:-1])[:, ::-1] + (0.0, 0.5),
    ])  # fmt: skip
    start = Circle(float(columns.mean()), float(rows.mean()), radius)
    circle = fitted_circle(rim, np.ones(len(rim)), start)
    residuals = np.hypot(rim[:, 0] - circle.column, rim[:, 1] - circle.row) / circle.radius - 1.0
    if (rms := float(np.sqrt(np.mean(residuals**2)))) > _MAX_ROUNDNESS_ERROR + 0.5 / radius:
        raise CalibrationRejected(
            f"the mask is not round: its edge is {rms:.1%} of the radius off a circle; let it be "
            "white on one sphere and black elsewhere"
        )
    error_px = float(np.hypot(centre_error(rim, np.ones(len(rim)), circle), _MASK_PX))
    return Outline(circle, rim, error_px, 1.0)


def find_outline(images: Array, *, is_mirror: bool = True) -> Outline:
    """Find the outline of the one sphere in (N, H, W) light images under N lights."""
    features = _features(images, is_mirror=is_mirror)
    height, width = features[0].shape
    factor = min(1.0, _SEARCH_PX / max(height, width))
    small = _reduced(features, factor)
    outlines = [
        _fitted(small, circle, _COARSE[:1])
        for circle in voted_circles(small, factor * _MIN_RADIUS_PX)
    ]
    outlines = sorted(outlines, key=_rank)[-_FINALISTS:]
    outlines = [_fitted(small, outline.circle, _COARSE[1:]) for outline in outlines]
    if max((outline.score for outline in outlines), default=0.0) <= 0.0:
        raise CalibrationRejected(_NO_SPHERE)
    best = _chosen(outlines)
    coarse, doubt_px = _scaled(best.circle, 1.0 / factor), _doubt_px(outlines, best) / factor
    factor = min(1.0, _FIT_RADIUS_PX / coarse.radius)
    fine = _fitted(_reduced(features, factor), _scaled(coarse, factor), _FINE)
    if max(best.score, fine.score) < _MIN_SCORE or fine.score < _MIN_FINE_SCORE:
        raise CalibrationRejected(_NO_SPHERE)
    circle = _scaled(fine.circle, 1.0 / factor)
    angles = np.linspace(0.0, 2.0 * np.pi, _RAYS, endpoint=False)
    columns = circle.column + circle.radius * np.cos(angles)
    rows = circle.row + circle.radius * np.sin(angles)
    beyond = (columns < -0.5) | (columns > width - 0.5) | (rows < -0.5) | (rows > height - 0.5)
    if float(np.mean(beyond)) > _MAX_CUT_SHARE:
        raise CalibrationRejected(
            f"the sphere at column {circle.column:.0f}, row {circle.row:.0f} with a radius of "
            f"{circle.radius:.0f} px is cut by the frame; show the whole of it"
        )
    rim = (fine.rim + 0.5) / factor - 0.5
    systematic_px = _SYSTEMATIC_SHARE * circle.radius / max(fine.score, _MIN_SCORE)
    random_px = float(np.hypot(fine.error_px / factor, doubt_px))
    error_px = float(np.hypot(random_px, systematic_px)) + _SYSTEMATIC_PX
    return Outline(circle, rim, error_px, fine.score)


_NO_SPHERE = (
    "no sphere is seen in the light images; put it on a background that is brighter or darker than "
    "its rim, or give a mask that is white where it is"
)


def _scaled(circle: Circle, factor: float) -> Circle:
    """The circle in a frame scaled by `factor`; pixel centres are whole numbers."""
    column, row = ((axis + 0.5) * factor - 0.5 for axis in circle[:2])
    return Circle(column, row, circle.radius * factor)


def _features(images: Array, *, is_mirror: bool) -> list[FloatMap]:
    """Square roots of the mean, largest and smallest value over the lights.

    For a mirror sphere also the log ratio of the brighter to the darker half of the lights, in
    which the albedo of the background cancels.
    """
    planes = (images.mean(axis=0, dtype=np.float32), images.max(axis=0), images.min(axis=0))
    top = max(float(image.max()) for image in planes) or 1.0
    if not is_mirror:
        return [np.sqrt(np.maximum(image.astype(np.float32) / top, 0.0)) for image in planes]
    roots = [np.sqrt(_share(image, top)) for image in planes]
    if len(images) < _RATIO_LIGHTS:
        return roots
    ordered = np.sort(images, axis=0)
    half = len(images) // 2
    brighter, darker = (
        np.log(_share(part.mean(axis=0, dtype=np.float32), top))
        for part in (ordered[half:-1], ordered[: len(images) - half])
    )
    return [*roots, brighter - darker]


def _share(image: Array, top: float) -> FloatMap:
    """The image as a share of `top`, above zero."""
    return np.asarray(np.maximum(image.astype(np.float32) / top, 0.0) + _BLACK_OFFSET, np.float32)


def _reduced(features: list[FloatMap], factor: float) -> list[FloatMap]:
    if factor == 1.0:
        return features
    height, width = features[0].shape
    size = (round(width * factor), round(height * factor))
    return [
        np.asarray(cv2.resize(feature, size, interpolation=cv2.INTER_AREA), np.float32)
        for feature in features
    ]


def _rank(outline: Outline) -> float:
    # A larger circle with the same share of edges is better evidence, but meets more edges of other
    # things by chance.
    return outline.score * float(outline.circle.radius**0.25)


def _chosen(outlines: list[Outline]) -> Outline:
    """The outline of the highest rank, or a circle around it that may be the edge of the sphere."""
    best = max(outlines, key=_rank)

    def is_around(outline: Outline) -> bool:
        dx, dy, growth = (a - b for a, b in zip(outline.circle, best.circle, strict=True))
        apart, ratio = float(np.hypot(dx, dy)), outline.circle.radius / best.circle.radius
        is_larger = apart < growth + _SAME_CENTRE * outline.circle.radius and ratio > _OUTER_RADIUS
        has_same_centre = apart < _SAME_CENTRE * outline.circle.radius and ratio > _LARGER
        return (is_larger or has_same_centre) and outline.score > _OUTER_SHARE * best.score

    return max(filter(is_around, outlines), key=lambda outline: outline.score, default=best)


def _doubt_px(outlines: list[Outline], best: Outline) -> float:
    """Half the largest difference of `best` from the circles that score about as high."""
    rivals = [
        np.subtract(outline.circle, best.circle)
        for outline in outlines
        if outline.score > _RIVAL_SHARE * best.score
        and 1.0 / _RIVAL_RADIUS < outline.circle.radius / best.circle.radius < _RIVAL_RADIUS
    ]
    return 0.5 * max(max(float(np.hypot(x, y)), abs(float(r))) for x, y, r in rivals)


def _radial_edges(
    features: list[FloatMap], circle: Circle, band_px: float
) -> tuple[Floats, Floats]:
    """(rays, k, 2) points of steepest slope along rays, and their weights 0 to 1."""
    step = 0.5
    radii = np.arange(max(circle.radius - band_px, 1.0), circle.radius + band_px, step)
    angles = np.arange(_RAYS) * (2.0 * np.pi / _RAYS)
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    columns = (circle.column + radii * rays[:, :1]).astype(np.float32)
    rows = (circle.row + radii * rays[:, 1:]).astype(np.float32)
    height, width = features[0].shape
    weights = np.zeros(columns.shape)
    for image in features:
        profile = cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        slope = np.abs(ndimage.gaussian_filter1d(profile, 1.0 / step, axis=1, order=1))
        typical = float(np.median(slope)) + 1e-6
        weights = np.maximum(weights, slope**2 / (slope**2 + (5.0 * typical) ** 2))
    weights *= (columns > 0) & (columns < width - 1) & (rows > 0) & (rows < height - 1)
    middle = weights[:, 1:-1]
    peaks = np.where((middle >= weights[:, :-2]) & (middle > weights[:, 2:]), middle, 0.0)
    peak = np.argsort(-peaks, axis=1)[:, :_EDGES_PER_RAY] + 1
    ray = np.arange(_RAYS)[:, None]
    before, here, after = weights[ray, peak - 1], weights[ray, peak], weights[ray, peak + 1]
    curvature = np.minimum(before - 2.0 * here + after, -1e-12)
    # The top of the parabola through three values.
    radius = radii[peak] + step * np.clip(0.5 * (before - after) / curvature, -0.5, 0.5)
    points = np.array(circle[:2]) + radius[..., None] * rays[:, None, :]
    return points, peaks[ray, peak - 1]


def _fitted(features: list[FloatMap], start: Circle, rounds: tuple[_Round, ...]) -> Outline:
    """Fit the circle near `start` with edges on most rays (RANSAC, least squares)."""
    rng = np.random.default_rng(0)
    circle, error_px, score = start, np.inf, 0.0
    rim = np.empty((0, 2))
    for band, tolerance_share, min_tolerance_px in rounds:
        band_px = max(band * start.radius, 4.0)
        tolerance = max(min_tolerance_px, tolerance_share * start.radius)
        points, weights = _radial_edges(features, circle, band_px)
        # Three rays about a third of the circumference apart.
        ray = rng.integers(0, _RAYS, (_TRIALS, 1)) + np.arange(3) * (_RAYS // 3)
        ray = (ray + rng.integers(-_RAYS // 9, _RAYS // 9, ray.shape)) % _RAYS
        trials = circles_through(points[ray, rng.integers(0, _EDGES_PER_RAY, ray.shape)])
        nudged = np.array(circle) + rng.normal(0.0, 0.3 * tolerance, (_TRIALS // 4, 3))
        trials = np.concatenate([trials, nudged, [circle]])
        trials = trials[np.abs(trials - np.array(circle)).max(axis=1) < band_px]
        scores = _scores(points, weights, trials, tolerance)
        circle = Circle(*map(float, trials[np.argmax(scores)]))
        for _ in range(3):
            distances = _signed_distances(points, np.array([circle]))[0]
            gain = weights * _nearness(distances, tolerance) ** 2
            best = np.argmax(gain, axis=1)
            gains = gain.max(axis=1)
            if (gains > 0.0).sum() < 3 * _SECTORS:
                return Outline(circle, rim, np.inf, 0.0)
            rim = points[np.arange(_RAYS), best][gains > 0.0]
            gains = gains[gains > 0.0]
            circle = fitted_circle(rim, gains, circle)
        score = float(_scores(points, weights, np.array([circle]), tolerance)[0])
        error_px = centre_error(rim, gains, circle)
    return Outline(circle, rim, error_px, score)


def _signed_distances(points: Floats, circles: Floats) -> Floats:
    """Distances (circles, rays, k) of points outside circles; negative inside."""
    x, y, radius = circles.astype(np.float32).T[:, :, None, None]
    near = points.astype(np.float32)
    return np.asarray(np.sqrt((near[..., 0] - x) ** 2 + (near[..., 1] - y) ** 2) - radius)


def _nearness(distances: Floats, tolerance: float) -> Floats:
    """Weight of an edge by its distance from the circle; its square is Tukey's biweight."""
    return np.asarray(np.maximum(1.0 - (distances / tolerance) ** 2, 0.0))


def _scores(points: Floats, weights: Floats, circles: Floats, tolerance: float) -> Floats:
    """Scores of circles: 1 for edges around the whole circumference."""
    # Share of the circumference with edges, less half of the share with edges just outside.
    distances = _signed_distances(points, circles)
    edges = (weights * _nearness(distances, tolerance)).max(axis=2)
    is_outside = (distances > tolerance) & (distances < 8.0 * tolerance)
    outside = np.where(is_outside, weights, 0.0).max(axis=2)
    sectors = (edges - 0.5 * outside).reshape(len(circles), _SECTORS, -1).mean(axis=2)
    return np.asarray(np.sqrt(np.maximum(sectors, 0.0)).mean(axis=1) ** 2)
