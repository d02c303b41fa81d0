"""Directions of lights from their shading of a matt sphere."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import optimize

from classify.errors import CalibrationRejected

from .sphere import FloatArray, Sphere

# Closer to the outline an error of it changes the normal most: 0.2 px of 50 px are 1.4 degrees at
# 0.9 of the radius, and 4 degrees at 0.99.
_INSIDE = 0.9
# Share of the light on the brightest pixel below which a pixel may be in shadow, or lit by what
# the surroundings return.
_LIT = 0.25
_SATURATED = 0.995
# Share of the sphere that must be lit and fit. A light at slant 75 reaches 0.4 of it.
_LEAST_USED = 0.2
_MOST_PIXELS = 3000
_SECTORS = 8
_ROUNDS = 4
# Powers of n . l in the shading: Lambert's law is linear; rough plaster, a response that is not
# linear, and a near lamp bend it, all as functions of n . l.
_POWERS = 3
# rms residual of the shading, as a share of its range, beyond which it is no matt sphere. Glossy
# paint gives 0.05, a mirror 0.3 and more (test_matte_sphere.py).
_WORST_RESIDUAL = 0.12


def matte_directions(
    images: npt.NDArray[Any], sphere: Sphere, full_scale: float
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Find the light of each picture by its shading of a matt sphere.

    The value of a lit pixel is a function of n . l alone; l and a polynomial of third degree are
    fitted to each picture by least squares, first with Lambert's law. Pixels in shadow, at full
    scale or far off the fit, such as gloss and dirt, are left out.

    Parameters
    ----------
    images
        (N, H, W) pictures, one per light, less ambient light where that is known.
    full_scale
        Value of saturation.

    Returns
    -------
    directions, errors_deg, levels
        (N, 3) unit vectors, (N,) standard errors, and (N,) brightnesses of a surface that faces the
        light, with a geometric mean of 1.
    residual
        rms deviation from the shading of a matt sphere, as a share of its range.

    Raises
    ------
    CalibrationRejected
        If a picture does not show the shading of a matt sphere; the message names it.
    """
    rows, columns = sphere.pixels(_INSIDE)
    every = -(-len(rows) // _MOST_PIXELS)
    rows, columns = rows[::every], columns[::every]
    normals, _ = sphere.surface_at(columns, rows)
    directions, errors, levels, residuals = [], [], [], []
    for light, image in enumerate(images):
        values = image[rows, columns].astype(np.float64)
        usable = values < _SATURATED * full_scale
        if usable.mean() < 0.7:
            raise CalibrationRejected(
                f"picture {light}: {1.0 - usable.mean():.0%} of the sphere is at full scale; "
                "shorten the exposure"
            )
        direction, level, residual, lit = _fit(normals[usable], values[usable], light)
        if residual > _WORST_RESIDUAL:
            raise CalibrationRejected(
                f"picture {light}: the shading is {residual:.0%} off that of a matt sphere; use a "
                "matt ball, and --sphere mirror for a polished one"
            )
        scatter = _jackknife_deg(normals[usable][lit], values[usable][lit], direction)
        # A shifted outline turns all normals; those that face the camera by the least.
        outline = np.degrees(sphere.error_px / sphere.radius_px) / max(direction[2], 0.3)
        errors.append(float(np.hypot(scatter, outline)))
        directions.append(direction)
        levels.append(level)
        residuals.append(residual)
    relative = np.array(levels) / np.exp(np.mean(np.log(levels)))
    return (
        np.array(directions),
        np.array(errors),
        relative,
        float(np.sqrt(np.mean(np.square(residuals)))),
    )


def _fit(
    normals: FloatArray, values: FloatArray, light: int
) -> tuple[FloatArray, float, float, npt.NDArray[np.bool_]]:
    """Direction, brightness at n . l = 1, relative residual, and the pixels that were used."""
    design = np.column_stack([normals, np.ones(len(normals))])
    lit = values > _LIT * np.quantile(values, 0.98)
    direction = np.array([0.0, 0.0, 1.0])
    for _ in range(_ROUNDS):
        scaled = np.linalg.lstsq(design[lit], values[lit], rcond=None)[0]
        length = float(np.linalg.norm(scaled[:3]))
        if length <= 1e-9 * max(float(values.max()), 1e-9):
            raise CalibrationRejected(f"picture {light}: the sphere is not shaded; is a light on?")
        direction = np.asarray(scaled[:3] / length, np.float64)
        lit = _kept(normals, values, direction, lit, light)
    for _ in range(2):
        direction = _refined(normals[lit], values[lit], direction)
        lit = _kept(normals, values, direction, lit, light)
    coefficients, off = _shading(normals[lit] @ direction, values[lit])
    level = float(np.polyval(coefficients, 1.0))
    span = float(np.ptp(np.polyval(coefficients, np.linspace(_LIT, 1.0, 16))))
    return direction, max(level, 1e-9), float(np.sqrt(np.mean(off**2))) / max(span, 1e-9), lit


def _kept(
    normals: FloatArray,
    values: FloatArray,
    direction: FloatArray,
    lit: npt.NDArray[np.bool_],
    light: int,
) -> npt.NDArray[np.bool_]:
    """Pixels that face the light and are within three robust standard deviations of the shading."""
    cosine = normals @ direction
    coefficients, off = _shading(cosine[lit], values[lit])
    spread = 1.4826 * float(np.median(np.abs(off))) + 1e-3 * float(np.ptp(values))
    far = np.abs(values - np.polyval(coefficients, np.clip(cosine, 0.0, 1.0))) > 3.0 * spread
    kept = np.asarray((cosine > _LIT) & ~far)
    if kept.mean() < _LEAST_USED:
        raise CalibrationRejected(
            f"picture {light}: {kept.mean():.0%} of the sphere shows the shading of a matt sphere; "
            "use a matt ball (--sphere mirror is for a polished one), and light it from above"
        )
    return kept


def _shading(cosine: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    coefficients = np.polyfit(cosine, values, _POWERS)
    return coefficients, values - np.polyval(coefficients, cosine)


def _refined(normals: FloatArray, values: FloatArray, start: FloatArray) -> FloatArray:
    """Direction, near `start`, by which the shading is best a function of n . l."""
    side = np.linalg.svd(start[None])[2][1:]  # two vectors across the direction

    def turned(step: FloatArray) -> FloatArray:
        direction = start + step @ side
        return np.asarray(direction / np.linalg.norm(direction))

    found = optimize.least_squares(
        lambda step: _shading(normals @ turned(step), values)[1],
        np.zeros(2), diff_step=1e-4, x_scale=0.01, max_nfev=20,
    )  # fmt: skip
    return turned(found.x)


def _jackknife_deg(normals: FloatArray, values: FloatArray, direction: FloatArray) -> float:
    """Standard error by fits that leave out one sector of the sphere each."""
    sector = np.floor((np.arctan2(normals[:, 1], normals[:, 0]) / (2 * np.pi) + 0.5) * _SECTORS)
    fits = [_refined(normals[sector != k], values[sector != k], direction) for k in range(_SECTORS)]
    variance = (_SECTORS - 1) / _SECTORS * ((np.array(fits) - np.mean(fits, axis=0)) ** 2).sum()
    return float(np.degrees(np.sqrt(variance / 2.0)))
