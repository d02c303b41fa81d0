"""Uncertainty of roughness and of height differences, from the deviations of the slopes.

Slope noise of variance v makes Sdq^2 larger by mean(v_p + v_q), and Sq^2 by the noise of the
height, which is white slope noise through the transfer function of `integrate_gradients`; both are
subtracted (GUM, JCGM 100:2008, 3.2.4). Model errors of neighbouring pixels are alike, so that
slope errors are not assumed to average out over a frame.
"""

import math
from dataclasses import dataclass

import numpy as np

from classify.base.arrays import BoolArray, FloatMap, Floats
from classify.calibration.calibration import CalibratedLights
from classify.lights.near_light import middle_px
from classify.surface.estimate import SurfaceEstimate

from .roughness import Roughness

# Expanded uncertainty: about 95 % (GUM 6.3.3).
_COVERAGE = 2.0
_LEAST = 1e-12


@dataclass(frozen=True)
class RoughnessUncertainty:
    """Parameters without the bias of noise, with expanded uncertainties (k = 2).

    Units as in `Roughness`. `height_sd_px` is the standard deviation of the difference of two
    heights by slope noise, by their distance in px.
    """

    corrected: Roughness
    expanded: Roughness
    height_sd_px: dict[float, float]


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
    completed = sum(
        _mean_square(plane, valid & ~solved) for plane in (surface.p_sd, surface.q_sd)
    ) * (1.0 - np.count_nonzero(solved) / count)
    noise = _HeightNoise.of(surface.shape)
    sq_bias = 0.5 * variance * noise.mean
    sdq = math.sqrt(max(roughness.sdq**2 - bias, 0.0))
    sq = math.sqrt(max(roughness.sq_px**2 - sq_bias, 0.0))
    # Errors of all slopes alike change Sdq by their root mean square in one direction; the
    # correction is known to its own size; completed slopes change Sdq^2 by at most their variance.
    u_sdq = math.hypot(
        math.sqrt(0.5 * variance),
        (roughness.sdq - sdq) / math.sqrt(3.0),
        completed / max(2.0 * roughness.sdq, _LEAST),
    )
    share = u_sdq / max(roughness.sdq, _LEAST)
    u_sq = math.hypot(share * roughness.sq_px, (roughness.sq_px - sq) / math.sqrt(3.0))
    return RoughnessUncertainty(
        corrected=Roughness(sdq, roughness.sdr_percent, roughness.sa_px, sq, count),
        expanded=Roughness(
            _COVERAGE * u_sdq,
            # Sdr is half of Sdq^2 for small slopes.
            _COVERAGE * 2.0 * share * roughness.sdr_percent,
            _COVERAGE * u_sq * roughness.sa_px / max(roughness.sq_px, _LEAST),
            _COVERAGE * u_sq,
            count,
        ),
        height_sd_px={
            distance: math.sqrt(0.5 * variance * noise.of_difference(distance))
            for distance in distances_px
        },
    )


def _mean_square(plane: FloatMap, where: BoolArray) -> float:
    values = plane[where]
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
        """Mean variance of a height without its plane, which is nearly the two longest waves."""
        power = self.power.copy()
        power[:2, :2] *= np.array([[1.0, 0.0], [0.0, 1.0]])[: power.shape[0], : power.shape[1]]
        return float(power.mean())

    def of_difference(self, distance_px: float) -> float:
        """Variance of the difference of two heights of a row, on both sides of the middle."""
        rows, columns = self.power.shape
        waves = np.arange(columns) * np.pi / columns
        middle, half = 0.5 * columns, 0.5 * min(distance_px, columns - 1.0)
        differences = np.cos(waves * (middle + half)) - np.cos(waves * (middle - half))
        return float((self.power * 2.0 * np.square(differences)).sum() / (rows * columns))


@dataclass(frozen=True)
class CommonError:
    """Effect of errors of the calibration, which are the same at all pixels, on the slopes."""

    mean_slope: float  # standard deviation of the mean slope
    slope_rms: float  # root mean square over the pixels
    sdq: float  # standard deviation of Sdq


def common_error(
    surface: SurfaceEstimate, lights: CalibratedLights, response_error: float = 0.0
) -> CommonError:
    """Propagate the standard errors of calibrated lights, and of the response.

    `response_error` is a share of full scale. With L' the true lights, the images of b are L' b,
    and the solution is L+ L' b. The misfit of the lights, which includes that of the flat field,
    counts as an error of their levels.
    """
    lighting = surface.lighting
    assert lighting is not None
    step = max(1, int(math.sqrt(surface.p.size / 4096)))
    sample = np.s_[::step, ::step]
    valid = surface.valid[sample]
    p, q, albedo = (
        plane[sample][valid].astype(np.float64) for plane in (surface.p, surface.q, surface.albedo)
    )
    rows, columns = (middle_px(side).astype(np.float64)[::step] for side in surface.shape)
    y, x = (plane[valid] for plane in np.meshgrid(-rows, columns, indexing="ij"))
    b, sdq = np.stack([-p, -q, np.ones_like(p)]), math.sqrt(float(np.mean(p * p + q * q)))
    weights = np.linalg.pinv(lighting.directions)
    means, squares, sdqs = np.zeros(2), 0.0, 0.0
    for k, direction in enumerate(lighting.directions):
        across = np.radians(lights.direction_errors_deg[k]) * np.linalg.svd(direction[None])[2][1:]
        changes = [*across @ b, lights.residual * (direction @ b)]
        if lights.distance_errors is not None and lighting.positions_px is not None:
            # The image of a near light is b . (l - X / R).
            distance = np.linalg.norm(lighting.positions_px[k])
            changes.append(-(p * x + q * y) * lights.distance_errors[k] / distance)
        value = response_error / lighting.intensities[k]
        changes.append(value * np.sqrt(1.0 + p * p + q * q) / np.maximum(albedo, _LEAST))
        for change in changes:
            off_x, off_y, off_z = b + weights[:, k, None] * change
            off = np.stack([-off_x / off_z - p, -off_y / off_z - q])
            means += np.square(off.mean(axis=1))
            squares += float(np.square(off).sum(axis=0).mean())
            changed = math.sqrt(float(np.mean(np.square(off - b[:2]).sum(axis=0))))
            sdqs += (changed - sdq) ** 2
    return CommonError(math.sqrt(float(means.sum())), math.sqrt(squares), math.sqrt(sdqs))
