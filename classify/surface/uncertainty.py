"""Standard deviations of slopes, albedo and normals, from noise and from departures of the model.

With b = M i the solution of a pixel, M follows from the lights that were used: the pseudo-inverse
of all, or of all but one. Independent errors of variance V_k of the images have the covariance
M diag(V) M^T, and p = -b_x / b_z, q = -b_y / b_z and rho = |b| the variances by the Jacobians of
these (GUM, JCGM 100:2008, section 5.1). V_k is the noise of the image, and the same model error
for all lights, as a share of the brightness, from the residuals of the pixels around.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from classify.base.arrays import Array, BoolArray, FloatMap, Floats, Indices
from classify.base.threads import STRIP_PX, run_on_rows
from classify.images import ImageStack, sample_pixels
from classify.lights.near_light import Shear, middle_px
from classify.shadow_rule import MAYBE_SHADOW, NO_DROPPED_LIGHT

from .deviation_kernels import (
    DEGREES,
    FIRST_POWER,
    KNOWN,
    OWN,
    POWERS,
    SECOND_AXIS,
    propagate_errors,
    walk_variances,
)
from .estimate import SurfaceEstimate

# Pixels whose residuals give the model error, on a grid; it is blurred by this many grid steps, so
# that about a hundred residuals count in each estimate.
_SAMPLES = 16_384
_BLUR = 3.0
# Standard error of a variance from these, as a share of it: a smaller excess can be chance.
_CHANCE = np.sqrt(2.0 / (4.0 * np.pi)) / _BLUR
# Weight of the residuals of the whole frame beside those around, for places without any.
_OF_FRAME = np.float32(1e-3)
_TINY = np.float32(1e-30)
# A lobe must explain residuals by as many standard deviations; one that explains this share of what
# the best explains is as likely.
_SIGNIFICANT, _AS_LIKELY = 5.0, 0.97


def with_deviations(
    surface: SurfaceEstimate, stack: ImageStack, taken: ImageStack, variance: FloatMap
) -> SurfaceEstimate:
    """Return the surface with the standard deviations of its maps.

    `stack` was solved, `taken` is the same before it was divided, and `variance` (3,) is a, b and
    black of the variance a + b (value - black) of its pixel values.
    """
    lighting = surface.lighting
    assert lighting is not None
    directions, shape = lighting.directions, surface.shape
    gains = 1.0 / ((surface.full_scale or 1.0) * lighting.intensities)
    pinv, (null, corrections) = np.linalg.pinv(directions), _without_one(directions)
    spare = 1.0 - np.sum(directions * pinv.T, axis=1)  # share of an error that is in the residuals
    solution = _Solution(surface, stack, taken, gains.astype(np.float32), variance)
    shares, strengths = _model_errors(solution, pinv.astype(np.float32))
    model = cv2.resize(shares, shape[::-1], interpolation=cv2.INTER_LINEAR)
    maps = [np.empty(shape, np.float32) for _ in range(4)]
    shear = Shear.of(lighting)
    x, y = middle_px(shape[1]), -middle_px(shape[0])
    arguments = [
        values.astype(np.float32)
        for values in (gains, variance, directions, pinv, spare, null, corrections, strengths)
    ]
    saturation = np.float32(surface.full_scale or np.inf)
    leaves_out = surface.method != "least_squares"

    def propagate(first: int, last: int) -> None:
        rows = slice(first, last)
        images, dark = stack.float_rows(first, last)
        raw = images if taken is stack else taken.images[:, rows].astype(np.float32)
        propagate_errors(
            images, dark, raw, *arguments, saturation, leaves_out, shear.plane,
            shear.inverse_distances, x, y[rows], surface.p[rows], surface.q[rows],
            surface.albedo[rows],
            surface.dropped[rows], model[rows], *(plane[rows] for plane in maps),
        )  # fmt: skip

    run_on_rows(propagate, shape)
    if surface.repaired is not None and surface.repaired.any():
        _replace_where_completed(surface, surface.repaired, maps)
    p_sd, q_sd, albedo_sd, angle_sd = maps
    return replace(surface, p_sd=p_sd, q_sd=q_sd, albedo_sd=albedo_sd, angle_sd=angle_sd)


@dataclass(frozen=True, eq=False)
class _Solution:
    """Arguments of `with_deviations`, with the factors from pixel values to the albedo."""

    surface: SurfaceEstimate
    stack: ImageStack
    taken: ImageStack
    gains: FloatMap
    variance: FloatMap

    def at(self, pixels: Indices) -> tuple[FloatMap, FloatMap]:
        """(N, n) values in units of the albedo, and their variances by the noise."""
        gains, (a, b, black) = self.gains[:, None], self.variance
        values, raw = self.stack.values_at(pixels), ImageStack.raw_at(self.taken, pixels)
        ratios = np.ones_like(raw)
        if self.taken is not self.stack:
            whole = ImageStack.values_at(self.taken, pixels)
            np.divide(values, whole, out=ratios, where=whole * whole > KNOWN * a)
        variances = np.square(gains * ratios) * (a + b * np.maximum(raw - black, np.float32(0.0)))
        return values * gains, variances


def _without_one(directions: Floats) -> tuple[Floats, Floats]:
    """Null vector nul and pinv / nul, of four lights: see `deviation_kernels`."""
    lights = len(directions)
    if lights != 4:
        return np.zeros(lights), np.zeros((3, lights))
    null = np.linalg.svd(directions.T)[2][3]
    return null, np.linalg.pinv(directions) / null


def _model_errors(solution: _Solution, pinv: FloatMap) -> tuple[FloatMap, Floats]:
    """Model errors of an image: variance as a share of the squared brightness, and gloss.

    The first on an (m, n) grid; the second as strengths of the lobes of `_lobes`.
    """
    surface, lighting = solution.surface, solution.surface.lighting
    assert lighting is not None
    shape, directions = surface.shape, lighting.directions.astype(np.float32)
    lights = len(directions)
    pixels = sample_pixels(shape, _SAMPLES)
    columns = int(np.count_nonzero(pixels < pixels[0] // shape[1] * shape[1] + shape[1]))
    rows = len(pixels) // columns
    if lights < 4:
        return np.zeros((rows, columns), np.float32), np.zeros(POWERS)
    values, variances = solution.at(pixels)
    p, q = surface.p.ravel()[pixels], surface.q.ravel()[pixels]
    bright = surface.valid.ravel()[pixels]
    if surface.repaired is not None:
        bright &= ~surface.repaired.ravel()[pixels]
    bright &= values.min(axis=0) > MAYBE_SHADOW * values.max(axis=0)
    all_used = surface.dropped.ravel()[pixels] == NO_DROPPED_LIGHT
    lit = bright & all_used if all_used.any() else bright
    remainder: FloatMap = np.eye(lights, dtype=np.float32) - directions @ pinv
    residuals = remainder @ values
    expected = np.diag(remainder) @ variances
    x, y = middle_px(shape[1])[pixels % shape[1]], -middle_px(shape[0])[pixels // shape[1]]
    across = np.stack([x, y, np.zeros_like(x)])
    towards = directions[:, :, None] - Shear.of(lighting).inverse_distances[:, None, None] * across
    lobes = _lobes(towards, p, q)
    strengths = _strengths(remainder @ lobes, residuals, bright / expected)
    lobe = np.tensordot(strengths.astype(np.float32), lobes, 1)
    excess = np.square(residuals - remainder @ lobe).sum(axis=0) - expected
    # Larger ones, as those of an edge, are errors of their own pixel: see `_judge`.
    usual = max(float(np.median(excess[lit])), 0.0) if lit.any() else 0.0
    excess = np.minimum(excess, OWN * (expected + usual))
    brightness = values.mean(axis=0)

    def around(quantity: FloatMap) -> FloatMap:
        plane = (lit * quantity).reshape(rows, columns)
        blurred = cv2.GaussianBlur(plane, (0, 0), _BLUR, borderType=cv2.BORDER_REFLECT)
        return np.asarray(blurred + _OF_FRAME * plane.mean(), np.float32)

    energy = np.maximum(around(excess) - _CHANCE * around(expected), 0.0) / (lights - 3)
    shares = (energy / np.maximum(around(brightness**2), _TINY)).astype(np.float32)
    return shares, strengths


def _replace_where_completed(
    surface: SurfaceEstimate, repaired: BoolArray, maps: list[FloatMap]
) -> None:
    """Write the deviations of completed slopes: those of a random walk from the solved ones.

    Its steps are the differences of neighbouring slopes around; one more step is that at the edge
    of the shadow.
    """
    p, q, solved = surface.p, surface.q, surface.valid & ~repaired
    pixels = np.flatnonzero(repaired)
    variances = np.empty(len(pixels), np.float32)

    def walk(first: int, last: int) -> None:
        walk_variances(pixels[first:last], p, q, solved, variances[first:last])

    run_on_rows(walk, (len(pixels), 1), STRIP_PX // 16)
    known = np.isfinite(variances)
    variances[~known] = variances[known].max(initial=1.0)
    steepness = 1.0 + p.ravel()[pixels] ** 2 + q.ravel()[pixels] ** 2
    deviations = np.sqrt(variances)
    # The eigenvalues of the variance of the normal are those along and across the slope.
    angles = DEGREES * deviations / steepness * np.sqrt(steepness + SECOND_AXIS)
    albedos = surface.albedo.ravel()[pixels] * deviations / np.sqrt(steepness)
    for plane, values in zip(maps, (deviations, deviations, albedos, angles), strict=True):
        plane.ravel()[pixels] = values


def _lobes(towards: Array, p: FloatMap, q: FloatMap) -> FloatMap:
    """(powers, N, n) Blinn-Phong lobes of the lights, of exponents 8, 16, ..."""
    halfway = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    halfway[:, 2] += np.float32(1.0)
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    power = np.maximum(halfway[:, 2] - halfway[:, 0] * p - halfway[:, 1] * q, np.float32(0.0))
    power /= np.sqrt(np.float32(1.0) + p * p + q * q)
    lobes = np.empty((POWERS, *power.shape), np.float32)
    for index in range(FIRST_POWER + POWERS):
        if index >= FIRST_POWER:
            lobes[index - FIRST_POWER] = power
        power = power * power
    return lobes


def _strengths(shapes: Array, residuals: Array, weights: Array) -> Floats:
    """Strengths of the lobes that explain residuals best; 0 if none does.

    `shapes` (powers, N, n) are the residuals of the lobes. Of lobes that explain as much, the mean
    of the sharper half is taken: a broad lobe is hardly told from a matt surface.
    """
    products = (weights * (shapes * residuals).sum(axis=1)).sum(axis=1)
    squares = (weights * np.square(shapes).sum(axis=1)).sum(axis=1)
    gains = np.maximum(products, 0.0) ** 2 / np.maximum(squares, _TINY)
    strengths = np.zeros(POWERS)
    if gains.max() > _SIGNIFICANT**2:
        likely = np.flatnonzero(gains >= _AS_LIKELY * gains.max())
        chosen = likely[len(likely) // 2 :]
        strengths[chosen] = products[chosen] / squares[chosen] / len(chosen)
    return strengths
