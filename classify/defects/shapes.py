"""Shapes of scratches, dents and stains: value and derivatives along and across their angle.

These are free choices of a shape, not fitted to real defects.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.float64]

# Share of a scratch's length over which a stylus enters, and leaves.
_ENTRY_SHARE = 0.25
# Share of an outline's radius at which stains and patches begin to fade.
_FADE_FROM = 0.6
# Radius of an outline as a share of size / 2: mean, and lobes with their amplitudes and phases. The
# outline has no symmetry, and stays between 0.7 and 1.
_MEAN_RADIUS = 0.85
_LOBES = ((2, 0.07, 0.0), (3, 0.05, 1.0), (5, 0.03, 2.5))


class Shape(NamedTuple):
    """Values of a shape, and their derivatives along and across the angle of the defect."""

    value: Image
    along: Image
    across: Image


def bump(diameter_px: float, along: Image, across: Image) -> Shape:
    """Raised cosine of height 1: smooth, and flat in the middle and at its finite edge."""
    radius_px = 0.5 * diameter_px
    phase = np.pi * np.minimum(np.hypot(along, across) / radius_px, 1.0)
    # Derivative by the radius, over the radius; finite in the middle, where sinc is 1.
    slope = -0.5 * (np.pi / radius_px) ** 2 * np.sinc(phase / np.pi)
    return Shape(0.5 + 0.5 * np.cos(phase), slope * along, slope * across)


def scratch(length_px: float, width_px: float, along: Image, across: Image) -> Shape:
    """Depth (1 - u^2) exp(-u^2 / 2) of a groove between two ridges, u in half widths across it."""
    half_px = 0.5 * width_px
    u = across / half_px
    bell = np.exp(-0.5 * u * u)
    profile, slope = (1.0 - u * u) * bell, (u * u - 3.0) * u * bell / half_px
    entry_px = _ENTRY_SHARE * length_px
    phase = np.pi * np.clip((0.5 * length_px - np.abs(along)) / entry_px, 0.0, 1.0)
    depth = 0.5 - 0.5 * np.cos(phase)
    depth_slope = -0.5 * np.pi / entry_px * np.sin(phase) * np.sign(along)
    return Shape(depth * profile, depth_slope * profile, depth * slope)


def blot(diameter_px: float, along: Image, across: Image) -> Shape:
    """Weight of a stain or a patch: 1 within, a raised cosine down to 0 at an irregular outline."""
    distance, angle = np.hypot(along, across), np.arctan2(across, along)
    # Radius of the outline, and its derivative by the angle.
    radius, radius_slope = np.full_like(distance, _MEAN_RADIUS), np.zeros_like(distance)
    for lobes, amplitude, start in _LOBES:
        radius += amplitude * np.cos(lobes * angle + start)
        radius_slope -= amplitude * lobes * np.sin(lobes * angle + start)
    radius *= 0.5 * diameter_px
    radius_slope *= 0.5 * diameter_px
    share = distance / radius
    phase = np.pi * np.clip((share - _FADE_FROM) / (1.0 - _FADE_FROM), 0.0, 1.0)
    fall = -0.5 * np.pi / (1.0 - _FADE_FROM) * np.sin(phase)
    # The gradient of the weight, outwards and anticlockwise.
    outwards, around = fall / radius, -fall * radius_slope / radius**2
    cos, sin = np.cos(angle), np.sin(angle)
    return Shape(
        0.5 + 0.5 * np.cos(phase), cos * outwards - sin * around, sin * outwards + cos * around
    )
