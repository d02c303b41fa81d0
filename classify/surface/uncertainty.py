"""Standard deviations of slopes, albedo and normals, from noise and model errors.

With b = M i the solution of a pixel, M follows from the lights that were used: the pseudo-inverse
of all, or of all but one. Independent errors of variance V_k of the images have the covariance
M diag(V) M^T. The variances of p = -b_x / b_z, q = -b_y / b_z and rho = |b| follow by first-order
propagation (GUM, JCGM 100:2008, section 5.1). V_k is the noise variance of image k plus the
variance of the model error. The latter is the same for all lights and proportional to squared
brightness; it is estimated from the residuals of neighbouring pixels.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from classify.base.arrays import Array, FloatMap, Floats, Indices
from classify.base.threads import STRIP_PX, run_on_rows
from classify.images import ImageStack, sample_pixels
from classify.lighting import Lighting
from classify.lights.near_light import Shear, coordinates_px
from classify.shadow_rule import MAYBE_SHADOW, NO_DROPPED_LIGHT

from .deviation_kernels import (
    FIRST_POWER,
    MIN_SQUARED_SNR,
    PIXEL_OUTLIER,
    POWERS,
    Lights,
    propagate_errors,
    write_repaired,
)
from .estimate import SurfaceEstimate

# Number of pixels on a grid whose residuals give the model error, and standard deviation in grid
# steps of the Gaussian that averages them: about a hundred residuals count in each estimate.
_SAMPLES = 8_192
_BLUR_STEPS = 3.0
# Relative standard error, sqrt(2 / n), of a variance from n = 4 pi _BLUR_STEPS**2 residuals. A
# smaller excess over the noise can be chance.
_VARIANCE_ERROR = np.sqrt(2.0 / (4.0 * np.pi)) / _BLUR_STEPS
# Weight of the mean of the frame in a local mean, for places without usable pixels nearby.
_FRAME_WEIGHT = np.float32(1e-3)
_TINY = np.float32(1e-30)
# Gloss steepens the solved slopes. A pixel with a dropped light has no residual that shows by how
# much: its specular lobe is evaluated at the solved slope times this factor
# (`tests.evidence.uncertainty`).
_GLOSS_SLOPE_FACTOR = np.float32(0.55)
# Least share of b_z that remains when the lobes are subtracted: a slope is a quotient by b_z.
_MIN_MATT_SHARE = np.float32(0.1)
_MAX_UNROLLED_LIGHTS = 8  # lights; loops over more take long to compile
# Least significance of a lobe in standard deviations. With four lights, which have one residual,
# lobes tie if they reduce chi squared by at least `_TIE_SHARE` of the largest reduction: see "Gloss
# in standard deviations" in classify/DECISIONS.md.
_MIN_LOBE_SIGMAS, _TIE_SHARE = 5.0, 0.97


def with_deviations(
    surface: SurfaceEstimate, stack: ImageStack, undivided: ImageStack, noise: FloatMap
) -> SurfaceEstimate:
    """Add standard deviations to a surface that was solved from `stack`.

    `undivided` is the stack before the division by flat field or fall-off; `noise` is a, b and
    black of the noise variance a + b (value - black) of its values.
    """
    lighting = surface.lighting
    assert lighting is not None
    shape = surface.shape
    gains = 1.0 / ((surface.full_scale or 1.0) * lighting.intensities)
    solution = _Solution(surface, stack, undivided, gains.astype(np.float32), noise)
    model_error_grid, strengths = _model_errors(solution)
    lobe_strengths = strengths.astype(np.float32) if strengths.any() else None
    model_error = cv2.resize(model_error_grid, shape[::-1], interpolation=cv2.INTER_LINEAR)
    maps = np.empty((4, *shape), np.float32)
    light_plane = Shear.of(lighting).plane  # of near lights, per px; 0 if distant
    lights, corrections, unit_covariances = _constants(lighting, gains)
    x, y = coordinates_px(shape)
    saturation = np.float32(surface.full_scale or np.inf)
    leaves_out = surface.method != "least_squares"
    # Other methods have no fitted factor: their lobes are those of the solved slopes.
    lobe_slope_factor = _GLOSS_SLOPE_FACTOR if surface.method == "ps4_robust" else np.float32(1.0)

    def propagate(first: int, last: int) -> None:
        rows = slice(first, last)
        images, dark = stack.float_rows(first, last)
        dropped = np.ascontiguousarray(surface.dropped[rows])  # may be one number, broadcast
        raw = None if undivided is stack else undivided.images[:, rows].astype(np.float32)
        propagate_errors(
            images, dark, raw, lights, corrections, unit_covariances, lobe_strengths, noise,
            saturation, leaves_out, lobe_slope_factor, light_plane, x, y[rows], surface.p[rows],
            surface.q[rows], surface.albedo[rows], dropped, model_error[rows], *maps[:, rows],
        )  # fmt: skip

    run_on_rows(propagate, shape, STRIP_PX // 2)
    if surface.repaired is not None:
        solved, repaired = surface.valid & ~surface.repaired, np.flatnonzero(surface.repaired)

        def write(first: int, last: int) -> None:
            write_repaired(
                repaired[first:last], surface.p, surface.q, surface.albedo, solved, *maps
            )

        run_on_rows(write, (len(repaired), 1), STRIP_PX // 16)
    p_sd, q_sd, albedo_sd, angle_sd = maps
    return replace(surface, p_sd=p_sd, q_sd=q_sd, albedo_sd=albedo_sd, angle_sd=angle_sd)


@dataclass(frozen=True, eq=False)
class _Solution:
    """A surface with the images that it was solved from, and their noise."""

    surface: SurfaceEstimate
    stack: ImageStack
    undivided: ImageStack
    gains: FloatMap  # factors from pixel values to the albedo
    noise: FloatMap

    def at(self, pixels: Indices) -> tuple[FloatMap, FloatMap]:
        """(N, n) values in units of the albedo, and their variances by the noise."""
        gains, (a, b, black) = self.gains[:, None], self.noise
        values, raw = self.stack.values_at(pixels), self.undivided.raw_at(pixels)
        division_factors = np.ones_like(raw)
        if self.undivided is not self.stack:
            undivided = self.undivided.values_at(pixels)
            is_above_noise = undivided * undivided > MIN_SQUARED_SNR * a
            np.divide(values, undivided, out=division_factors, where=is_above_noise)
        variances = np.square(gains * division_factors) * (
            a + b * np.maximum(raw - black, np.float32(0.0))
        )
        return values * gains, variances


def _constants(lighting: Lighting, gains: Floats) -> tuple[Lights, FloatMap, FloatMap]:
    """Constants of the lights, corrections, and covariances.

    The corrections are the columns of pinv / nul, which correct b for a left-out light. The
    covariances of b are from errors of variance 1: of each image, and of the ambient image.
    """
    count, inverse_distances = len(lighting), Shear.of(lighting).inverse_distances
    directions = _without_rounding_residues(lighting.directions)
    pinv = _without_rounding_residues(np.linalg.pinv(directions))
    null, corrections = np.zeros(count), np.zeros((4, 3))
    if count == 4:
        null = _without_rounding_residues(np.linalg.svd(directions.T)[2][3])
        corrections = pinv.T / null[:, None]
    redundancies = 1.0 - np.sum(directions * pinv.T, axis=1)  # 1 - leverage of each light
    columns = (gains, directions, pinv.T, null, redundancies, inverse_distances)
    lights: Lights = np.column_stack(columns).astype(np.float32)
    if count <= _MAX_UNROLLED_LIGHTS:
        lights = tuple(tuple(light) for light in lights)
    upper, ambient_response = np.triu_indices(3), pinv @ gains
    unit_covariances = np.stack([
        _without_rounding_residues(covariance)[upper]
        for covariance in (pinv @ pinv.T, np.outer(ambient_response, ambient_response))
    ])  # fmt: skip
    return lights, corrections.astype(np.float32), unit_covariances.astype(np.float32)


def _without_rounding_residues(values: Array) -> Floats:
    """Replace residues of rounding by 0: kernels are slow with subnormal products."""
    return np.where(np.abs(values) < 1e-9 * np.abs(values).max(), 0.0, values)


def _model_errors(solution: _Solution) -> tuple[FloatMap, Floats]:
    """(m, n) grid of model error variances over squared brightness; strengths of `_lobes`."""
    surface, lighting = solution.surface, solution.surface.lighting
    assert lighting is not None
    shape, directions = surface.shape, lighting.directions.astype(np.float32)
    light_count, pinv = len(directions), np.linalg.pinv(directions).astype(np.float32)
    pixels = sample_pixels(shape, _SAMPLES)
    # Number of samples in the first sampled row.
    columns = int(np.count_nonzero(pixels < pixels[0] // shape[1] * shape[1] + shape[1]))
    rows = len(pixels) // columns
    if light_count < 4:
        return np.zeros((rows, columns), np.float32), np.zeros(POWERS)
    values, variances = solution.at(pixels)
    p, q = surface.p.ravel()[pixels], surface.q.ravel()[pixels]
    is_unshadowed = surface.valid.ravel()[pixels]
    if surface.repaired is not None:
        is_unshadowed &= ~surface.repaired.ravel()[pixels]
    is_unshadowed &= values.min(axis=0) > MAYBE_SHADOW * values.max(axis=0)
    all_used = surface.dropped.ravel()[pixels] == NO_DROPPED_LIGHT
    # Local means are of pixels that were solved from all lights, if there are any.
    is_averaged = is_unshadowed & all_used if all_used.any() else is_unshadowed
    residual_projector: FloatMap = np.eye(light_count, dtype=np.float32) - directions @ pinv
    residuals = residual_projector @ values
    noise_square = np.diag(residual_projector) @ variances  # expected sum of squared residuals
    x_of_columns, y_of_rows = coordinates_px(shape)
    x, y = x_of_columns[pixels % shape[1]], y_of_rows[pixels // shape[1]]
    positions = np.stack([x, y, np.zeros_like(x)])
    inverse_distances = Shear.of(lighting).inverse_distances[:, None, None]
    light_vectors = directions[:, :, None] - inverse_distances * positions
    b_z = surface.albedo.ravel()[pixels] / np.sqrt(np.float32(1.0) + p * p + q * q)
    # Gloss biases the solved slopes, so that the first lobes are too weak: fit them again at the
    # slopes without them.
    for _ in range(2):
        lobes = _lobes(light_vectors, p, q)
        strengths = _strengths(residual_projector @ lobes, residuals, is_unshadowed / noise_square)
        lobe = np.tensordot(strengths.astype(np.float32), lobes, 1)
        if not strengths.any():
            break
        lobe_x, lobe_y, lobe_z = pinv @ lobe
        matt_z = np.maximum(b_z - lobe_z, _MIN_MATT_SHARE * b_z + np.float32(1e-6))
        p, q = (b_z * p + lobe_x) / matt_z, (b_z * q + lobe_y) / matt_z
    excess = np.square(residuals - residual_projector @ lobe).sum(axis=0) - noise_square
    median_excess = max(float(np.median(excess[is_averaged])), 0.0) if is_averaged.any() else 0.0
    # An excess above this limit, as at an edge, counts in its own pixel only: `propagate_errors`.
    excess = np.minimum(excess, PIXEL_OUTLIER * (noise_square + median_excess))
    brightness = values.mean(axis=0)

    def local_mean(quantity: FloatMap) -> FloatMap:
        plane = (is_averaged * quantity).reshape(rows, columns)
        blurred = cv2.GaussianBlur(plane, (0, 0), _BLUR_STEPS, borderType=cv2.BORDER_REFLECT)
        return np.asarray(blurred + _FRAME_WEIGHT * plane.mean(), np.float32)

    significant_excess = local_mean(excess) - _VARIANCE_ERROR * local_mean(noise_square)
    model_error_variance = np.maximum(significant_excess, 0.0) / (light_count - 3)
    squared_brightness = np.maximum(local_mean(brightness**2), _TINY)
    return (model_error_variance / squared_brightness).astype(np.float32), strengths


def _lobes(light_vectors: Array, p: FloatMap, q: FloatMap) -> FloatMap:
    """(powers, N, n) Blinn-Phong lobes of the lights, of exponents 8, 16, ..."""
    halfway = light_vectors / np.linalg.norm(light_vectors, axis=1, keepdims=True)
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
    """Fit the likeliest lobes of `shapes` (powers, N, n) to residuals; 0 if not significant."""
    products = (weights * (shapes * residuals).sum(axis=1)).sum(axis=1)
    squares = (weights * np.square(shapes).sum(axis=1)).sum(axis=1)
    chi2_reductions = np.maximum(products, 0.0) ** 2 / np.maximum(squares, _TINY)
    strengths = np.zeros(POWERS)
    if chi2_reductions.max() > _MIN_LOBE_SIGMAS**2:
        min_share = _TIE_SHARE if shapes.shape[1] == 4 else 1.0
        likely = np.flatnonzero(chi2_reductions >= min_share * chi2_reductions.max())
        # The sharper half and the middle one: broad lobes look like matt shading.
        chosen = likely[(len(likely) - 1) // 2 :]
        strengths[chosen] = products[chosen] / squares[chosen] / len(chosen)
    return strengths
