"""Directions of lights from their images in a mirror sphere, or their shading of a matt one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy import ndimage, optimize

from classify.base.arrays import Array, BoolArray, Floats, Indices
from classify.base.errors import CalibrationRejected
from classify.images import SIGMA_PER_MAD

from .circle import jackknife_variances
from .sphere import Sphere

# A pixel belongs to a highlight if more than this share of it shows the lamp. The share is higher
# for a highlight at full scale, which lit walls beside the lamp approach (to 0.7 in a test).
_HIGHLIGHT, _CLIPPED_HIGHLIGHT = 0.5, 0.8
# Least share in the brightest pixel of a highlight; a lit wall or a glossy table does not reach it.
_MIN_PEAK = 0.9
# Used share of the radius; farther out the pixels mix with the background.
_USED_RADIUS = 0.97
# Least ratio of a highlight's peak to the changes of the rest of the sphere, by their robust
# scatter. Noise alone gives 4.5; a lamp that lights a bright room unevenly leaves 5.7
# (sphere_rates.py).
_MIN_CONTRAST, _MIN_CHANGE = 5.0, 2.0
# A second reflection with this share of the light of the first makes the choice doubtful.
_DOUBTFUL_SHARE = 0.5
# Least z of the direction of a light; lower ones are reflections, for example in the table.
_MIN_Z = 0.02
# A reflection that fills more than this solid angle (steradian, a cone of 30 degrees radius) is a
# lit wall or an overexposed light image.
_MAX_HIGHLIGHT_SR = 2.0 * np.pi * (1.0 - np.cos(np.radians(30.0)))
# Error of a highlight's centre as a share of its size, as a lamp is not brightest in its middle.
_CENTRE_SHARE = 0.1
# Error in px of the centre of a highlight of a few pixels, whose light is clipped at full scale.
_CENTRE_ERROR_PX = 0.15


class _Highlight(NamedTuple):
    """The image of a lamp in a mirror sphere."""

    brightness: float  # sum over the pixels, above the background
    pixels: Indices  # into those of the sphere
    weights: Floats  # of the pixels
    direction: Floats  # (3,) of the light

    @classmethod
    def of(cls, pixels: Indices, change: Floats, weights: Floats, reflected: Floats) -> Self:
        direction = weights[pixels] @ reflected[pixels]
        direction /= np.linalg.norm(direction)
        return cls(float(change[pixels].sum()), pixels, weights[pixels], direction)


def mirror_directions(
    images: Array, sphere: Sphere, ambient: Array | None = None
) -> tuple[Floats, Floats, Floats, list[str]]:
    """Directions of lights (N, 3) from the highlights of a mirror sphere.

    They are the means of l = 2 (n . v) n - v over each highlight. Returns also their errors in
    degrees, the reflecting points (N, 3), and doubts.
    """
    rows, columns = sphere.pixels(_USED_RADIUS)
    cells = rows - rows.min(), columns - columns.min()
    values = images[:, rows, columns].astype(np.float64)
    dark_images = () if ambient is None else (ambient[rows, columns].astype(np.float64),)
    normals, views = sphere.surface_at(columns, rows)
    reflected = 2.0 * (normals * views).sum(axis=1)[:, None] * normals - views
    directions, errors, points, doubts = [], [], [], []
    for light in range(len(values)):
        background = _background([*np.delete(values, light, axis=0), *dark_images], values[light])
        highlights = _highlights(values[light], background, light, cells, reflected)
        brightness, pixels, weights, direction = highlights[0]
        if pixels.size * 4.0 / sphere.radius_px**2 > _MAX_HIGHLIGHT_SR:
            raise CalibrationRejected(
                f"light image {light}: the light fills {pixels.size / len(rows):.0%} of the "
                "sphere; use a smaller lamp or a shorter exposure, and a polished sphere"
            )
        if len(highlights) > 1 and highlights[1].brightness > _DOUBTFUL_SHARE * brightness:
            doubts.append(
                f"light image {light} has two reflections that differ from the other light images, "
                f"with {highlights[1].brightness / brightness:.0%} of the light of the brighter "
                "one, which was taken"
            )
        normal = direction + weights @ views[pixels] / weights.sum()
        normal /= np.linalg.norm(normal)
        squares = ((reflected[pixels] - direction) ** 2).sum(axis=1)
        size = np.sqrt(weights @ squares / weights.sum())  # of the highlight, rms, in radians
        n_z = max(float(normal[2]), 0.1)
        # Per px, n rotates by 1 / (radius n_z), and l by twice as much.
        outline_error, centre_error = (
            2.0 * px / sphere.radius_px / n_z for px in (sphere.error_px, _CENTRE_ERROR_PX)
        )
        error = np.linalg.norm([outline_error, centre_error, _CENTRE_SHARE * size])
        errors.append(np.degrees(error))
        directions.append(direction)
        points.append(sphere.centre + sphere.radius_px * normal)
    return np.array(directions), np.array(errors), np.array(points), doubts


def _highlights(
    values: Floats,
    background: Floats,
    light: int,
    cells: tuple[Indices, Indices],
    reflected: Floats,
) -> list[_Highlight]:
    """Highlights by lights on the camera's side, the brightest first; at least one."""
    share, threshold = _lit_share(values, background, light, cells)
    labels = _labels(share > threshold, cells)
    regions = [np.flatnonzero(labels == number) for number in range(1, int(labels.max()) + 1)]
    highlights = [
        _Highlight.of(pixels, values - background, share - threshold, reflected)
        for pixels in regions
        if share[pixels].max() >= _MIN_PEAK
    ]
    usable = [highlight for highlight in highlights if highlight.direction[2] > _MIN_Z]
    if not usable:
        raise CalibrationRejected(
            f"light image {light}: its brightest reflection is in the rim of the sphere, as of "
            "a light behind the plane of the part; light it from the camera's side, or leave "
            "this light out"
        )
    return sorted(usable, key=lambda highlight: -highlight.brightness)


def _background(others: Sequence[Floats], values: Floats) -> Floats:
    """Image without this light: median of the other images, or minimum of one or two."""
    if not others:
        return np.full(values.shape, np.median(values))
    return np.asarray(np.median(others, axis=0) if len(others) > 2 else np.min(others, axis=0))


def _lit_share(
    values: Floats, background: Floats, light: int, cells: tuple[Indices, Indices]
) -> tuple[Floats, float]:
    """Share of each pixel, 0 to 1, that shows the light, and the limit of a highlight."""
    change = values - background
    highest = float(change.max())
    middle = float(np.median(change))
    scatter = SIGMA_PER_MAD * float(np.median(np.abs(change - middle)))
    # Without scatter, integer values are still uncertain by one digit.
    noise = max(scatter, 1.0 if float(values.max()) > 1.0 else 0.0)
    if highest - middle < _MIN_CONTRAST * noise or highest <= 0.0:
        raise CalibrationRejected(
            f"light image {light} has no highlight on the sphere that the others lack; is it a "
            "polished sphere, and does each light image have its own light?"
        )
    is_changed = change > _MIN_CHANGE * noise + middle
    core = change >= 0.5 * highest  # of the highlight
    # Over a bright reflection of the room a clipped highlight changes less than over a dark one.
    bright = values[_connected(core, is_changed & (values >= values[core].max()), cells)]
    is_clipped = (bright == bright.max()).sum() > 1
    share = change / (np.maximum(bright.max() - background, 1e-9) if is_clipped else highest)
    threshold = _CLIPPED_HIGHLIGHT if is_clipped else _HIGHLIGHT
    return np.where(is_changed, np.clip(share, 0.0, 1.0), 0.0), threshold


def _connected(core: BoolArray, others: BoolArray, cells: tuple[Indices, Indices]) -> BoolArray:
    """Pixels of `core`, and of `others` that are connected with it."""
    labels = _labels(core | others, cells)
    return np.asarray(np.isin(labels, labels[core]))


def _labels(is_marked: BoolArray, cells: tuple[Indices, Indices]) -> Indices:
    """(n,) number of the connected region of each marked cell; 0 for the others."""
    grid = np.zeros((int(cells[0].max()) + 1, int(cells[1].max()) + 1), np.bool_)
    grid[cells] = is_marked
    return np.asarray(ndimage.label(grid, np.ones((3, 3)))[0][cells])


# Share of the radius that is used. Near the outline its error changes the normal most: 0.2 px of
# 50 px are 1.4 degrees at 0.9 of the radius, and 4 degrees at 0.99.
_SHADED_SHARE = 0.9
# Share of the light on the brightest pixel below which a pixel may be in shadow, or lit by its
# surroundings.
_MIN_LIT_SHARE = 0.25
# Share of full scale from which on a pixel counts as saturated.
SATURATED = 0.995
# Least share of the sphere below full scale: its brightest part shows the light best.
_MIN_UNSATURATED_SHARE = 0.6
# Share of the sphere that must be lit and fit. A light at slant 75 reaches 0.4 of it.
_MIN_USED_SHARE = 0.2
_MAX_PIXELS = 3000
# Error by vignetting and response, which the jackknife does not show. Half of the lights of matt
# spheres in masks are within 0.2 degrees, 90 % within 0.65 (sphere_rates.py).
_MODEL_DEG = 0.3
_ROUNDS = 4
# Powers of n . l in the shading: Lambert's law is linear; rough plaster, a response that is not
# linear, and a near lamp bend it, all as functions of n . l.
_POWERS = 3
# Bounds of the fitted vignetting, as the share of light missing in the corners. Lenses have up to
# 0.6; a rough sphere may look like slightly negative vignetting.
_VIGNETTING = (-0.2, 0.6)
# Largest rms residual of the shading of a matt sphere, as a share of its range. Glossy
# paint gives 0.05, a mirror 0.3 and more (test_matte_sphere.py).
_WORST_RESIDUAL = 0.12


def matte_directions(
    images: Array, sphere: Sphere, full_scale: float, vignetting: float | None = None
) -> tuple[Floats, Floats, Floats, float]:
    """Directions of lights (N, 3) from the shading of a matt sphere.

    The shading is a cubic in n . l times the vignetting, whose loss in the corners is fitted if it
    is None. Returns also errors in degrees, levels and residual.
    """
    rows, columns = sphere.pixels(_SHADED_SHARE)
    stride = -(-len(rows) // _MAX_PIXELS)
    rows, columns = rows[::stride], columns[::stride]
    normals, _ = sphere.surface_at(columns, rows)
    middle = 0.5 * (np.array(sphere.frame) - 1.0)
    offsets = np.stack([rows, columns], axis=1) - middle
    squared_radii = (offsets**2).sum(axis=1) / (middle @ middle)
    samples = []
    for light, image in enumerate(images):
        values = image[rows, columns].astype(np.float64)
        usable = values < SATURATED * full_scale
        if usable.mean() < _MIN_UNSATURATED_SHARE:
            raise CalibrationRejected(
                f"light image {light}: {1.0 - usable.mean():.0%} of the sphere is at full scale; "
                "shorten the exposure"
            )
        samples.append(_Samples(light, normals[usable], values[usable], squared_radii[usable]))
    # The lens is the same in all light images.
    if vignetting is None:
        vignetting = float(np.median([_fit(sample, None).vignetting for sample in samples]))
    fits = [_fit(sample, vignetting) for sample in samples]
    errors = []
    for sample, fit in zip(samples, fits, strict=True):
        if fit.residual > _WORST_RESIDUAL:
            raise CalibrationRejected(
                f"light image {sample.light}: the shading is {fit.residual:.0%} off that of a matt "
                "sphere; use a matt ball, and --sphere mirror for a polished one"
            )
        scatter = _jackknife_deg(sample.only(fit.lit), fit)
        # A shifted outline rotates all normals, least those that face the camera.
        outline_error = np.degrees(sphere.error_px / sphere.radius_px) / max(fit.direction[2], 0.3)
        errors.append(float(np.linalg.norm([scatter, outline_error, _MODEL_DEG])))
    levels = np.array([fit.level for fit in fits])
    residual = float(np.sqrt(np.mean([fit.residual**2 for fit in fits])))
    directions = np.array([fit.direction for fit in fits])
    return directions, np.array(errors), levels / np.exp(np.mean(np.log(levels))), residual


@dataclass(frozen=True, eq=False)
class _Samples:
    """Pixels of the sphere in one light image."""

    light: int
    normals: Floats
    values: Floats
    squared_radii: Floats  # squared distances from the middle of the frame; 1 in its corners

    def only(self, used: BoolArray) -> _Samples:
        return _Samples(self.light, self.normals[used], self.values[used], self.squared_radii[used])

    def without(self, vignetting: float) -> Floats:
        """The values without vignetting."""
        return self.values / (1.0 - vignetting * self.squared_radii)


@dataclass(frozen=True, eq=False)
class _Fit:
    direction: Floats
    vignetting: float
    level: float  # value of a surface that faces the light
    residual: float  # rms, as a share of the range of values
    lit: BoolArray  # the pixels that were used


def _fit(samples: _Samples, vignetting: float | None) -> _Fit:
    """Fit one light image; its vignetting too if that is None."""
    normals, values = samples.normals, samples.values
    design = np.column_stack([normals, np.ones(len(normals))])
    lit = values > _MIN_LIT_SHARE * np.quantile(values, 0.98)
    direction, share = np.array([0.0, 0.0, 1.0]), vignetting or 0.0
    for _ in range(_ROUNDS):
        scaled = np.linalg.lstsq(design[lit], samples.without(share)[lit], rcond=None)[0]
        length = float(np.linalg.norm(scaled[:3]))
        if length <= 1e-9 * max(float(values.max()), 1e-9):
            raise CalibrationRejected(
                f"light image {samples.light}: the sphere is not shaded; is a light on?"
            )
        direction = np.asarray(scaled[:3] / length, np.float64)
        lit = _fitting_pixels(samples, direction, share, lit)
    for _ in range(2):
        direction, share = _refined(samples.only(lit), direction, vignetting)
        lit = _fitting_pixels(samples, direction, share, lit)
    coefficients, residuals = _shading(normals[lit] @ direction, samples.without(share)[lit])
    level = max(float(np.polyval(coefficients, 1.0)), 1e-9)
    span = float(np.ptp(np.polyval(coefficients, np.linspace(_MIN_LIT_SHARE, 1.0, 16))))
    residual = float(np.sqrt(np.mean(residuals**2))) / max(span, 1e-9)
    return _Fit(direction, share, level, residual, lit)


def _fitting_pixels(
    samples: _Samples, direction: Floats, vignetting: float, lit: BoolArray
) -> BoolArray:
    """Pixels that face the light and fit the shading to three robust deviations."""
    cosine, values = samples.normals @ direction, samples.without(vignetting)
    coefficients, residuals = _shading(cosine[lit], values[lit])
    spread = SIGMA_PER_MAD * float(np.median(np.abs(residuals))) + 1e-3 * float(np.ptp(values))
    shading = np.polyval(coefficients, np.clip(cosine, 0.0, 1.0))
    fitting = np.asarray((cosine > _MIN_LIT_SHARE) & (np.abs(values - shading) <= 3.0 * spread))
    if fitting.mean() < _MIN_USED_SHARE:
        raise CalibrationRejected(
            f"light image {samples.light}: {fitting.mean():.0%} of the sphere shows the shading of "
            "a matt sphere; use a matt ball (--sphere mirror is for a polished one), lit from above"
        )
    return fitting


def _shading(cosine: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Coefficients of the shading as a function of n . l, and the residuals."""
    coefficients = np.polyfit(cosine, values, _POWERS)
    return coefficients, values - np.polyval(coefficients, cosine)


def _refined(samples: _Samples, start: Floats, vignetting: float | None) -> tuple[Floats, float]:
    """Direction near `start` and vignetting with the least residual of the shading."""
    across = np.linalg.svd(start[None])[2][1:]  # two vectors across the direction

    def stepped(step: Floats) -> Floats:
        direction = start + step @ across
        return np.asarray(direction / np.linalg.norm(direction))

    def residuals(values: Floats) -> Floats:
        share = float(values[2]) if vignetting is None else vignetting
        return _shading(samples.normals @ stepped(values[:2]), samples.without(share))[1]

    unknowns = 3 if vignetting is None else 2
    low, high = [-1.0, -1.0, _VIGNETTING[0]][:unknowns], [1.0, 1.0, _VIGNETTING[1]][:unknowns]
    solution = optimize.least_squares(
        residuals, np.zeros(unknowns), bounds=(low, high), diff_step=1e-4,
        x_scale=[0.01, 0.01, 0.1][:unknowns], max_nfev=20,
    )  # fmt: skip
    return stepped(solution.x[:2]), float(solution.x[2]) if vignetting is None else vignetting


def _jackknife_deg(samples: _Samples, fit: _Fit) -> float:
    """Standard error of the direction, per axis across it."""
    x, y, _ = samples.normals.T
    variances = jackknife_variances(
        x, y, lambda used: _refined(samples.only(used), fit.direction, fit.vignetting)[0]
    )
    return float(np.degrees(np.sqrt(variances.sum() / 2.0)))
