"""Blur of the images, described by one number: the variance of a Gaussian in px^2.

A Gaussian of variance v multiplies the power of slopes and of albedo by exp(-4 pi^2 v f^2), f in
cycles per pixel. The features that blur changes do not depend on the angle: the mean of each ring
of a spectrum, and local statistics. They are computed at a few variances, the knots, and
interpolated linearly.
"""

import math
from dataclasses import replace
from functools import partial
from typing import Any

import cv2
import numpy as np

from classify.base.arrays import Array, FloatMap, Floats
from classify.base.compiling import kernel
from classify.base.threads import run_on_rows
from classify.surface.estimate import SurfaceEstimate

from .fields import TextureFields, texture_fields

KNOTS_PX2 = (0.65, 1.69, 4.0)
"""Variances at which the features of a blurred surface are computed.

Half way between two knots, interpolated statistics add less than 0.03 to the squared distance to a
set of the same surface, in the unit in which quarters of a frame differ by 1: measured on the eight
kinds of test_joint_blur.py.
"""

MAX_BLURRIER_PX, MAX_SHARPER_PX = math.sqrt(KNOTS_PX2[2]), math.sqrt(KNOTS_PX2[1])
"""Largest blur of a test relative to a reference, and of a reference relative to a test.

The second is smaller, because the statistics of the reference are then extrapolated.
"""

EXTRAPOLATION = KNOTS_PX2[1] / KNOTS_PX2[0]
"""Ratio of the first two knots: statistics are extrapolated in proportion to the variance."""

# As the blur grows, the difference of a test and a reference moves along a path of straight lines;
# these are the variances of its corners. Below 0 the reference is the blurrier of the two.
_PATH_PX2 = (-KNOTS_PX2[1], -KNOTS_PX2[0], 0.0, *KNOTS_PX2)
# Penalty on a squared distance per px^2 of blur, because blur brings unknown surfaces nearer. It is
# larger for frames below `_SUFFICIENT_PX` squared, in which textures scatter as much as blur
# changes them: see "Focus" in classify/DECISIONS.md.
_PENALTY = 0.3
_AREA_POWER = 0.7
_SUFFICIENT_PX = 256


def blur_gains(radii_cpp: Floats) -> FloatMap:
    """(3, R) factors of power at the knots, for frequencies in cycles per pixel."""
    exponents = np.outer(KNOTS_PX2, -4.0 * np.pi**2 * np.square(radii_cpp))
    gains: FloatMap = np.exp(exponents).astype(np.float32)
    return gains


def blurred_fields(fields: TextureFields, variance_px2: float) -> TextureFields:
    """Blur slopes and albedo by a Gaussian: nearly the same as blurring the images."""
    sigma_px = math.sqrt(variance_px2)
    p, q, albedo = (
        np.asarray(
            cv2.GaussianBlur(plane, (0, 0), sigma_px, borderType=cv2.BORDER_REFLECT_101), np.float32
        )
        for plane in (fields.p, fields.q, fields.albedo)
    )
    return TextureFields(p, q, albedo)


def blurred_surface(surface: SurfaceEstimate, sigma_px: float) -> SurfaceEstimate:
    """The same surface seen out of focus; pixels that are not valid are filled in."""
    fields = blurred_fields(texture_fields(surface), sigma_px**2)
    return replace(
        surface, p=fields.p, q=fields.q, albedo=fields.albedo, valid=np.ones_like(surface.valid)
    )


def blur_penalty(pixels: float) -> np.float32:
    """Penalty per px^2 of blur, for training frames of that many pixels."""
    deficit = max(_SUFFICIENT_PX**2 / max(pixels, 1.0), 1.0)
    return np.float32(_PENALTY * deficit**_AREA_POWER)


def min_over_blurs(
    test: FloatMap,
    test_curve: FloatMap,
    references: FloatMap,
    curves: FloatMap,
    rings: int,
    penalty: np.float32,
) -> tuple[Floats, Floats]:
    """(n,) squared distances plus penalty, least over all blurs, and the (n,) blurs in px^2."""
    # `test` (d,) and `references` (n, d) are features, of which the first `rings` are ring means;
    # `test_curve` (3, d) and `curves` (n, 3, d) are their changes at the knots. A variance is that
    # of the test minus that of the reference.
    minima = np.empty((len(references), 2), np.float64)
    rows = partial(_min_rows, test, test_curve, references, curves, rings, penalty, minima)
    run_on_rows(rows, references.shape)
    return minima[:, 0], minima[:, 1]


@kernel
def _min_rows(
    test: Array, test_curve: Array, references: Array, curves: Array, rings: int,
    penalty: np.float32, minima: Array, first: int, stop: int,
) -> None:  # fmt: skip
    for n in range(first, stop):
        squares, products = path_products(test, test_curve, references[n], curves[n], rings)
        minima[n] = min_on_path(squares, products, penalty)


@kernel
def path_products(
    test: Array, test_curve: Array, reference: Array, curve: Array, rings: int
) -> tuple[Any, Any]:
    """Squared differences at the six `_PATH_PX2`, and inner products of neighbours."""
    zero = np.float32(0.0)
    s0, s1, s2, s3, s4, s5 = zero, zero, zero, zero, zero, zero
    p0, p1, p2, p3, p4 = zero, zero, zero, zero, zero
    for k in range(len(test)):
        difference = test[k] - reference[k]
        change = curve[0, k]
        # If the test is sharper, its ring means are blurred. Its statistics are not known after a
        # blur, so those of the reference are extrapolated.
        if k < rings:
            a, b = difference + test_curve[1, k], difference + test_curve[0, k]
        else:
            a, b = difference + np.float32(EXTRAPOLATION) * change, difference + change
        d, e, f = difference - change, difference - curve[1, k], difference - curve[2, k]
        s0 += a * a
        p0 += a * b
        s1 += b * b
        p1 += b * difference
        s2 += difference * difference
        p2 += difference * d
        s3 += d * d
        p3 += d * e
        s4 += e * e
        p4 += e * f
        s5 += f * f
    return (s0, s1, s2, s3, s4, s5), (p0, p1, p2, p3, p4)


@kernel
def min_on_path(squares: Any, products: Any, penalty: np.float32) -> tuple[np.float32, np.float32]:
    """Smallest squared distance plus penalty on the path `_PATH_PX2`, and its variance."""
    # On each segment the squared distance is a parabola, and the penalty is linear.
    zero = np.float32(0.0)
    minimum, variance = squares[2], zero
    for k in range(len(products)):
        low, high = np.float32(_PATH_PX2[k]), np.float32(_PATH_PX2[k + 1])
        # Minus half of the derivative of the squared distance by `share`, at the start.
        descent = squares[k] - products[k]
        length_squared = max(descent + squares[k + 1] - products[k], np.float32(1e-12))
        cost = penalty * (abs(high) - abs(low))
        share = (descent - np.float32(0.5) * cost) / length_squared
        share = min(max(share, zero), np.float32(1.0))
        square = squares[k] + share * (share * length_squared - np.float32(2.0) * descent)
        square += penalty * abs(low) + share * cost
        if square < minimum:
            minimum, variance = square, low + share * (high - low)
    return minimum, variance
