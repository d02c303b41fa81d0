"""Areal roughness parameters of ISO 25178-2 from gradients and relative height."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from classify.base.arrays import BoolArray, FloatMap, Floats
from classify.base.errors import InputError
from classify.calibration.calibration import CalibratedLights
from classify.lights.near_light import coordinates_px
from classify.surface.estimate import SurfaceEstimate

from .height import integrate_gradients


@dataclass(frozen=True)
class Roughness:
    """ISO 25178-2 parameters over the valid pixels of a surface.

    Attributes
    ----------
    sdq
        Root mean square gradient, dimensionless. From the gradients alone.
    sdr_percent
        Developed interfacial area ratio: how much larger the surface is than its projection, in
        percent. From the gradients alone.
    sa_px, sq_px
        Arithmetical mean height and root mean square height in pixels, of the relative height
        without its mean plane. Errors of the gradients add up over the frame, so compare these
        only between frames of one size.
    valid_pixels
        Number of valid pixels.
    """

    sdq: float
    sdr_percent: float
    sa_px: float
    sq_px: float
    valid_pixels: int


def root_mean_square_slope(surface: SurfaceEstimate) -> float:
    """Sdq of ISO 25178-2 over the valid pixels; NaN if there are none."""
    count = int(np.count_nonzero(surface.valid))
    if count == 0:
        return float("nan")
    mask = surface.valid.view(np.uint8)
    squares = (cv2.norm(plane, cv2.NORM_L2SQR, mask) for plane in (surface.p, surface.q))
    return math.sqrt(sum(squares) / count)


def surface_roughness(surface: SurfaceEstimate, height: FloatMap | None = None) -> Roughness:
    """Compute Sdq and Sdr from the gradients, Sa and Sq from the relative height.

    Parameters
    ----------
    surface
        Its p, q and valid are used.
    height
        (H, W) relative height; None to integrate it from p and q.

    Raises
    ------
    InputError
        If no pixel is valid, a value is not finite, or the height has another shape.

    Notes
    -----
    After ISO 25178-2:2021, means over the valid pixels:

        Sdq = sqrt(mean(p^2 + q^2))         Sdr = 100 % mean(sqrt(1 + p^2 + q^2) - 1)
        Sa = mean(|z|)                      Sq = sqrt(mean(z^2))

    with z the height without its least-squares plane (the F-operation). Gradients are not levelled:
    a tilted part has a larger Sdq. All four grow with the noise of the images. Slopes are those at
    the scale of a pixel: a coarser image of the same part has a smaller Sdq.
    """
    valid = surface.valid
    count = int(np.count_nonzero(valid))
    if count == 0:
        raise InputError("no pixel of this surface is valid; check exposure and lights")
    if height is None:
        height = integrate_gradients(surface.p, surface.q, surface.valid)
    if height.shape != surface.shape:
        raise InputError(f"the height is {height.shape}, the surface {surface.shape}")
    zero = np.float32(0.0)
    p, q, z = (np.where(valid, values, zero) for values in (surface.p, surface.q, height))
    if not all(np.isfinite(values).all() for values in (p, q, z)):
        raise InputError(
            "gradients or height contain NaN or infinity; mark such pixels as not valid"
        )
    steepness = p * p + q * q
    # sqrt(1 + s) - 1, written without loss of digits on a flat surface.
    developed = steepness / (np.sqrt(1.0 + steepness) + 1.0)
    levelled = _levelled(z, valid)
    return Roughness(
        sdq=float(np.sqrt(steepness.sum(dtype=np.float64) / count)),
        sdr_percent=100.0 * float(developed.sum(dtype=np.float64) / count),
        sa_px=float(np.abs(levelled).sum(dtype=np.float64) / count),
        sq_px=float(np.sqrt(np.square(levelled).sum(dtype=np.float64) / count)),
        valid_pixels=count,
    )


def _levelled(height: FloatMap, valid: BoolArray) -> FloatMap:
    """Subtract the least-squares plane of the valid pixels; 0 elsewhere."""
    rows, columns = valid.shape
    # Coordinates within [-1, 1] keep the normal equations well conditioned in any frame.
    y, x = np.linspace(1.0, -1.0, rows), np.linspace(-1.0, 1.0, columns)
    row_counts, column_counts = (valid.sum(axis=axis, dtype=np.float64) for axis in (1, 0))
    row_heights, column_heights = (height.sum(axis=axis, dtype=np.float64) for axis in (1, 0))
    n, s_x, s_y, s_xy = row_counts.sum(), column_counts @ x, row_counts @ y, y @ (valid @ x)
    products = [[n, s_x, s_y], [s_x, column_counts @ x**2, s_xy], [s_y, s_xy, row_counts @ y**2]]
    moments = [row_heights.sum(), column_heights @ x, row_heights @ y]
    # The solution of least norm, because one pixel or one row does not determine a plane.
    level, along_x, along_y = np.linalg.lstsq(products, moments, rcond=1e-9)[0]
    plane = (level + along_y * y).astype(np.float32)[:, None] + (along_x * x).astype(np.float32)
    levelled: FloatMap = (height - plane) * valid
    return levelled


# Slope noise of variance v makes Sdq^2 larger by mean(v_p + v_q), and Sq^2 by the noise of the
# height, which is white slope noise through the transfer function of `integrate_gradients`; both
# are subtracted (GUM, JCGM 100:2008, 3.2.4). Model errors of neighbouring pixels are alike, so that
# slope errors are not assumed to average out over a frame.

# Expanded uncertainty: about 95 % (GUM 6.3.3).
_COVERAGE_FACTOR = 2.0
_MIN_DIVISOR = 1e-12


@dataclass(frozen=True)
class RoughnessUncertainty:
    """Parameters without noise bias, and expanded uncertainties (k = 2) in their units."""

    corrected: Roughness
    expanded: Roughness
    height_sd_px: dict[float, float]  # of height differences, by distance in px


def roughness_uncertainty(
    surface: SurfaceEstimate, roughness: Roughness, distances_px: tuple[float, ...] = ()
) -> RoughnessUncertainty:
    """Correct parameters for noise, and state their uncertainties; `surface` has deviations."""
    assert surface.p_sd is not None
    assert surface.q_sd is not None
    valid, count = surface.valid, roughness.valid_pixels
    solved = valid if surface.repaired is None else valid & ~surface.repaired
    variance = sum(_mean_square(plane, solved) for plane in (surface.p_sd, surface.q_sd))
    bias = variance * np.count_nonzero(solved) / count
    repaired_variance = sum(
        _mean_square(plane, valid & ~solved) for plane in (surface.p_sd, surface.q_sd)
    ) * (1.0 - np.count_nonzero(solved) / count)
    noise = _HeightNoise.of(surface.shape)
    sq_bias = 0.5 * variance * noise.mean
    sdq = math.sqrt(max(roughness.sdq**2 - bias, 0.0))
    sq = math.sqrt(max(roughness.sq_px**2 - sq_bias, 0.0))
    # Three errors of Sdq. An error that all slopes have in common changes it by its root mean
    # square in one direction. The correction is uncertain by its own size. Repaired slopes change
    # Sdq^2 by at most their variance.
    u_sdq = math.hypot(
        math.sqrt(0.5 * variance),
        (roughness.sdq - sdq) / math.sqrt(3.0),
        repaired_variance / max(2.0 * roughness.sdq, _MIN_DIVISOR),
    )
    relative_u = u_sdq / max(roughness.sdq, _MIN_DIVISOR)
    u_sq = math.hypot(relative_u * roughness.sq_px, (roughness.sq_px - sq) / math.sqrt(3.0))
    return RoughnessUncertainty(
        corrected=Roughness(sdq, roughness.sdr_percent, roughness.sa_px, sq, count),
        expanded=Roughness(
            _COVERAGE_FACTOR * u_sdq,
            # Sdr is half of Sdq^2 for small slopes.
            _COVERAGE_FACTOR * 2.0 * relative_u * roughness.sdr_percent,
            _COVERAGE_FACTOR * u_sq * roughness.sa_px / max(roughness.sq_px, _MIN_DIVISOR),
            _COVERAGE_FACTOR * u_sq,
            count,
        ),
        height_sd_px={
            distance: math.sqrt(0.5 * variance * noise.of_difference(distance))
            for distance in distances_px
        },
    )


def _mean_square(plane: FloatMap, mask: BoolArray) -> float:
    values = plane[mask]
    return float(np.square(values, dtype=np.float64).mean()) if values.size else 0.0


@dataclass(frozen=True, eq=False)
class _HeightNoise:
    """Variance of the height for white slopes of variance 1, in the cosine basis."""

    power: Floats  # (H, W) of each wave

    @classmethod
    def of(cls, shape: tuple[int, int]) -> "_HeightNoise":
        """As `integrate_gradients` does: slopes at half pixels, Poisson's equation."""
        rows, columns = (0.5 * np.pi * np.arange(side) / side for side in shape)
        y, x = np.square(2.0 * np.sin(rows))[:, None], np.square(2.0 * np.sin(columns))
        half_y, half_x = np.square(np.cos(rows))[:, None], np.square(np.cos(columns))
        eigenvalues = y + x
        eigenvalues[0, 0] = 1.0
        power = (y * half_y + x * half_x) / eigenvalues**2
        power[0, 0] = 0.0
        return cls(np.asarray(power, np.float64))

    @property
    def mean(self) -> float:
        """Mean variance of a height without its plane."""
        power = self.power.copy()
        # A plane is nearly the sum of the longest wave along rows and that along columns.
        power[:1, 1:2] = power[1:2, :1] = 0.0
        return float(power.mean())

    def of_difference(self, distance_px: float) -> float:
        """Variance of the difference of two heights of a row, on both sides of the middle."""
        rows, columns = self.power.shape
        waves = np.arange(columns) * np.pi / columns
        middle, half = 0.5 * columns, 0.5 * min(distance_px, columns - 1.0)
        differences = np.cos(waves * (middle + half)) - np.cos(waves * (middle - half))
        return float((self.power * 2.0 * np.square(differences)).sum() / (rows * columns))


@dataclass(frozen=True)
class _CommonError:
    """Effect of errors of the calibration, which are the same at all pixels, on the slopes."""

    mean_slope: float  # standard deviation of the mean slope
    slope_rms: float  # root mean square over the pixels
    sdq: float  # standard deviation of Sdq


def common_error(
    surface: SurfaceEstimate, lights: CalibratedLights, response_error: float = 0.0
) -> _CommonError:
    """Propagate errors of the calibrated lights and of the response, a share of full scale.

    With wrong lights L' the solution is b' = L+ L' b. The misfit counts as errors of the levels.
    """
    lighting = surface.lighting
    assert lighting is not None
    step = max(1, int(math.sqrt(surface.p.size / 4096)))
    sample = np.s_[::step, ::step]
    valid = surface.valid[sample]
    p, q, albedo = (
        plane[sample][valid].astype(np.float64) for plane in (surface.p, surface.q, surface.albedo)
    )
    axes = (axis.astype(np.float64)[::step] for axis in coordinates_px(surface.shape))
    x, y = (plane[valid] for plane in np.meshgrid(*axes))
    b, sdq = np.stack([-p, -q, np.ones_like(p)]), math.sqrt(float(np.mean(p * p + q * q)))
    weights = np.linalg.pinv(lighting.directions)
    mean_variances, slope_variance, sdq_variance = np.zeros(2), 0.0, 0.0
    for k, direction in enumerate(lighting.directions):
        across = np.radians(lights.direction_errors_deg[k]) * np.linalg.svd(direction[None])[2][1:]
        changes = [*across @ b, lights.residual * (direction @ b)]
        if lights.distance_errors is not None and lighting.positions_px is not None:
            # The image of a near light is b . (l - X / R).
            distance = np.linalg.norm(lighting.positions_px[k])
            changes.append(-(p * x + q * y) * lights.distance_errors[k] / distance)
        share = response_error / lighting.intensities[k]
        changes.append(share * np.sqrt(1.0 + p * p + q * q) / np.maximum(albedo, _MIN_DIVISOR))
        for change in changes:
            changed_x, changed_y, changed_z = b + weights[:, k, None] * change
            errors = np.stack([-changed_x / changed_z - p, -changed_y / changed_z - q])
            mean_variances += np.square(errors.mean(axis=1))
            slope_variance += float(np.square(errors).sum(axis=0).mean())
            changed_sdq = math.sqrt(float(np.mean(np.square(errors - b[:2]).sum(axis=0))))
            sdq_variance += (changed_sdq - sdq) ** 2
    mean_variance = float(mean_variances.sum())
    return _CommonError(*map(math.sqrt, (mean_variance, slope_variance, sdq_variance)))
