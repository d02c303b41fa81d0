"""Directions of lights from their images in a mirror sphere."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from scipy import ndimage

from classify.base.arrays import Array, Floats, Indices
from classify.base.errors import CalibrationRejected
from classify.images import SIGMA_PER_MAD

from .sphere import Sphere

# A pixel belongs to a highlight if more than this share of it shows the lamp. The share is higher
# for a highlight at full scale, which lit walls beside the lamp approach (to 0.7 in a test).
_HIGHLIGHT, _CLIPPED_HIGHLIGHT = 0.5, 0.8
# Least share in the brightest pixel of a highlight; a lit wall or a glossy table does not reach it.
_LEAST_PEAK = 0.9
# Used share of the radius; farther out the pixels mix with the background.
_INSIDE = 0.97
# Least ratio of a highlight's peak to the changes of the rest of the sphere, by their robust
# scatter. Noise alone gives 4.5; a lamp that lights a bright room unevenly leaves 5.7
# (sphere_rates.py).
_LEAST_CONTRAST, _LEAST_CHANGE = 5.0, 2.0
# A second reflection with this share of the light of the first makes the choice doubtful.
_DOUBTFUL = 0.5
# Least z of the direction of a light; lower ones are reflections, for example in the table.
_LOWEST_Z = 0.02
# A reflection that fills more than this solid angle (steradian, a cone of 30 degrees radius) is a
# lit wall or an overexposed light image.
_LARGEST = 2.0 * np.pi * (1.0 - np.cos(np.radians(30.0)))
# Error of a highlight's centre as a share of its size, as a lamp is not brightest in its middle.
_CENTRE_SHARE = 0.1
# Error in px of the centre of a highlight of a few pixels, whose light is clipped at full scale.
_PIXEL = 0.15


class _Highlight(NamedTuple):
    """The image of a lamp in a mirror sphere."""

    brightness: float
    pixels: Indices
    weights: Floats
    direction: Floats  # (3,) of the light

    @classmethod
    def of(cls, pixels: Indices, change: Floats, weights: Floats, towards: Floats) -> Self:
        direction = weights[pixels] @ towards[pixels]
        direction /= np.linalg.norm(direction)
        return cls(float(change[pixels].sum()), pixels, weights[pixels], direction)


def mirror_directions(
    images: Array, sphere: Sphere, ambient: Array | None = None
) -> tuple[Floats, Floats, Floats, list[str]]:
    """(N, 3) directions of lights by a mirror sphere, errors_deg, (N, 3) points, doubts.

    l = 2 (n . v) n - v is averaged over the highlight, weighted by the light: equal areas of the
    image of a mirror sphere are equal solid angles, 4 / radius^2.
    """
    rows, columns = sphere.pixels(_INSIDE)
    top, left = int(rows.min()), int(columns.min())
    values = images[:, rows, columns].astype(np.float64)
    without = () if ambient is None else (ambient[rows, columns].astype(np.float64),)
    normals, views = sphere.surface_at(columns, rows)
    towards = 2.0 * (normals * views).sum(axis=1)[:, None] * normals - views
    shape = (int(rows.max()) - top + 1, int(columns.max()) - left + 1)
    directions, errors, points, doubts = [], [], [], []
    for light in range(len(values)):
        room = _room([*np.delete(values, light, axis=0), *without], values[light])
        change = values[light] - room
        share, least = _lit_share(values[light], room, light)
        picture = np.zeros(shape, np.bool_)
        picture[rows - top, columns - left] = share > least
        labels = ndimage.label(picture, np.ones((3, 3)))[0][rows - top, columns - left]
        highlights = [
            _Highlight.of(pixels, change, share - least, towards)
            for number in range(1, int(labels.max()) + 1)
            for pixels in [np.flatnonzero(labels == number)]
            if share[pixels].max() >= _LEAST_PEAK
        ]
        above = [highlight for highlight in highlights if highlight.direction[2] > _LOWEST_Z]
        if not above:
            raise CalibrationRejected(
                f"light image {light}: its brightest reflection is in the rim of the sphere, as of "
                "a light behind the plane of the part; light it from the camera's side, or leave "
                "this light out"
            )
        above.sort(key=lambda highlight: -highlight.brightness)
        brightness, pixels, weights, direction = above[0]
        if pixels.size * 4.0 / sphere.radius_px**2 > _LARGEST:
            raise CalibrationRejected(
                f"light image {light}: the light fills {pixels.size / len(rows):.0%} of the "
                "sphere; use a smaller lamp or a shorter exposure, and a polished sphere"
            )
        if len(above) > 1 and above[1].brightness > _DOUBTFUL * brightness:
            doubts.append(
                f"light image {light} has two reflections that differ from the other light images, "
                f"with {above[1].brightness / brightness:.0%} of the light of the brighter one, "
                "which was taken"
            )
        normal = direction + weights @ views[pixels] / weights.sum()
        normal /= np.linalg.norm(normal)
        spread = np.sqrt(weights @ ((towards[pixels] - direction) ** 2).sum(axis=1) / weights.sum())
        n_z = max(float(normal[2]), 0.1)
        # Per px, n rotates by 1 / (radius n_z), and l by twice as much.
        outline, pixel = (2.0 * px / sphere.radius_px / n_z for px in (sphere.error_px, _PIXEL))
        errors.append(np.degrees(np.sqrt(outline**2 + pixel**2 + (_CENTRE_SHARE * spread) ** 2)))
        directions.append(direction)
        points.append(sphere.centre + sphere.radius_px * normal)
    return np.array(directions), np.array(errors), np.array(points), doubts


def _room(others: Sequence[Floats], values: Floats) -> Floats:
    """The room without this light: median of the other light images, minimum of up to two."""
    if not others:
        return np.full(values.shape, np.median(values))
    return np.asarray(np.median(others, axis=0) if len(others) > 2 else np.min(others, axis=0))


def _lit_share(values: Floats, room: Floats, light: int) -> tuple[Floats, float]:
    """Share of each pixel, 0 to 1, that shows the light, and the limit of a highlight."""
    change = values - room
    highest = float(change.max())
    middle = float(np.median(change))
    scatter = SIGMA_PER_MAD * float(np.median(np.abs(change - middle)))
    # Values of one digit have no scatter, and are uncertain by one.
    noise = max(scatter, 1.0 if float(values.max()) > 1.0 else 0.0)
    if highest - middle < _LEAST_CONTRAST * noise or highest <= 0.0:
        raise CalibrationRejected(
            f"light image {light} has no highlight on the sphere that the others lack; is it a "
            "polished sphere, and does each light image have its own light?"
        )
    bright = values[change >= 0.5 * highest]
    is_clipped = (bright == bright.max()).sum() > 1
    share = change / (np.maximum(bright.max() - room, 1e-9) if is_clipped else highest)
    is_changed = change > _LEAST_CHANGE * noise + middle
    least = _CLIPPED_HIGHLIGHT if is_clipped else _HIGHLIGHT
    return np.where(is_changed, np.clip(share, 0.0, 1.0), 0.0), least
