"""Positions of LEDs near a white sheet, from the ratios of their light images.

Each light image of a matt sheet is a product of the reflectance, the vignetting, the LED level and
cos(incidence) cos^m(emission) / r^2. Reflectance and vignetting cancel in the ratio of two images.
For an LED at P, relative to the middle of the frame, and v = P / |P|^2, the last factor is at a
point X of the sheet proportional to

    (1 - v . X)^m (1 - 2 v . X + |v|^2 |X|^2)^(-(3 + m) / 2)        LED that points to the middle
    (1 - 2 v . X + |v|^2 |X|^2)^(-(3 + m) / 2)                      LED that points straight down

A distant light has v = 0.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.optimize import least_squares

from classify.base.arrays import Floats

Aim = Literal["centre", "down"]

# Initial distances (in half of the longer side) and slant of the fit. It converges from both
# distances for LEDs at distances of 3 to 30 (tests/classify/calibration/test_led_positions.py).
_START_DISTANCES, _START_SLANT_DEG = (3.0, 10.0), 45.0
# Largest lobe exponent: the beam of cos^20 is too narrow to light a frame.
_MAX_LOBE_EXPONENT = 20.0
# Lower limit of 1 - v . X before the logarithm; it is negative behind an LED.
_MIN_FACING = 1e-6
_BLOCKS = 16  # number of fitted blocks along the frame
_CLUSTERS = 8  # number of clusters along the frame, whose residuals count as independent
# With more lights, half as many blocks along the frame: the Jacobian would need gigabytes.
_MANY_LIGHTS = 16
# Factor on the standard errors: without it 12 % of the errors on 40 rendered sheets exceeded two
# standard errors, instead of 5 % (random lights, lobes, dust and tilts as in
# tests/classify/calibration/test_led_positions.py).
_ERROR_FACTOR = 1.4


@dataclass(frozen=True, eq=False)
class LedPositions:
    """Positions of N LEDs as fitted, with their uncertainties."""

    positions: Floats  # (N, 3) in half of the longer side, from the middle of the frame
    direction_errors_deg: Floats  # (N,) standard errors
    distance_errors: Floats  # (N,) relative standard errors
    lobe_exponent: float  # m of the strength cos^m at an angle to the axis of an LED
    aim: Aim  # where the axes point
    residual: float  # rms deviation of the logarithms of the ratios from the model
    # (N, n, n) log ratio less the model, also of blocks without weight; n is 16, or 8 for more than
    # 16 lights.
    residuals: Floats


def fit_led_positions(ratios: Floats, weights: Floats, x: Floats, y: Floats) -> LedPositions:
    """Fit N >= 3 LEDs to (N, n, n) log ratios of each light to the geometric mean of all."""
    size = _BLOCKS if len(ratios) <= _MANY_LIGHTS else _BLOCKS // 2
    pooled = block_sums(weights, size)
    used = pooled > 0.0
    total = np.where(used, pooled, 1.0)
    columns, rows = np.meshgrid(x, y)
    block_x, block_y = (
        block_sums(axis * weights, size)[used] / total[used] for axis in (columns, rows)
    )
    data = block_sums(ratios * weights, size)[:, used] / total[used]
    root_weights = np.sqrt(pooled[used] / pooled.max())
    aims: tuple[Aim, ...] = ("centre", "down")
    models = [_Model(block_x, block_y, data, root_weights, aim) for aim in aims]
    fits = [(model.fitted(start), model) for model in models for start in model.starts()]
    solution, model = min(fits, key=lambda fit: fit[0].cost)
    v, exponent = solution.x[: 3 * len(data)].reshape(-1, 3), float(solution.x[-1])
    squares = np.square(v).sum(axis=1)
    along, across = model.errors(solution)
    all_blocks = _Model(
        x=_means(columns, size).ravel(),
        y=_means(rows, size).ravel(),
        data=_means(ratios, size).reshape(len(data), -1),
        root_weights=np.ones(size * size),
        aim=model.aim,
    )
    residuals = -all_blocks.differences(solution.x).reshape(len(data), size, size)
    mean_square = np.square(solution.fun).sum() / (len(data) * np.square(root_weights).sum())
    return LedPositions(
        positions=v / squares[:, None],
        direction_errors_deg=np.degrees(across / np.sqrt(squares)),
        distance_errors=along / np.sqrt(squares),
        lobe_exponent=exponent,
        aim=model.aim,
        residual=float(np.sqrt(mean_square)),
        residuals=residuals,
    )


@dataclass(frozen=True, eq=False)
class _Model:
    """Log ratios of n points of the sheet, minus (N, n) `data`.

    Parameters are v of each light, the log levels relative to that of the first light, and m.
    """

    x: Floats
    y: Floats
    data: Floats
    root_weights: Floats
    aim: Aim

    def starts(self) -> list[Floats]:
        """Initial parameters: LEDs in the directions of their gradients, at two distances."""
        plane = np.stack([np.ones_like(self.x), self.x, self.y], axis=1)
        level, *gradient = np.linalg.lstsq(plane, self.data.T, rcond=None)[0]
        towards = np.stack(gradient, axis=1)
        towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
        slant = np.radians(_START_SLANT_DEG)
        unit = np.column_stack([np.sin(slant) * towards, np.full(len(level), np.cos(slant))])
        levels = level[1:] - level[0]
        return [
            np.concatenate([(unit / distance).ravel(), levels, [1.0]])
            for distance in _START_DISTANCES
        ]

    def fitted(self, start: Floats) -> Any:
        """Result of scipy's least squares."""
        low, high = np.full(start.size, -np.inf), np.full(start.size, np.inf)
        low[2 : 3 * len(self.data) : 3] = 0.0
        low[-1], high[-1] = 0.0, _MAX_LOBE_EXPONENT
        # Derivatives by complex steps are exact, so that their rank shows what is undetermined.
        return least_squares(
            self.differences, start, jac="cs", bounds=(low, high), x_scale="jac", max_nfev=200
        )

    def errors(self, solution: Any) -> tuple[Floats, Floats]:
        """(N,) standard errors of v along itself and across.

        The sum of clustered (Cameron and Miller 2015) and independent errors; infinite if the
        Jacobian is rank-deficient.
        """
        lights = len(self.data)
        # The rank is too low, for example, if all lights are in one place.
        if np.linalg.matrix_rank(solution.jac) < solution.x.size:
            return np.full(lights, np.inf), np.full(lights, np.inf)
        columns, rows = (np.floor((axis + 1.0) * 0.5 * _CLUSTERS) for axis in (self.x, self.y))
        cluster = columns * 2 * _CLUSTERS + rows
        scores = (solution.jac * solution.fun[:, None]).reshape(lights, cluster.size, -1)
        scores = scores.sum(axis=0)
        clustered = np.stack([scores[cluster == k].sum(axis=0) for k in np.unique(cluster)])
        inverse = np.linalg.pinv(solution.jac.T @ solution.jac)
        degrees_of_freedom = max((lights - 1) * cluster.size - solution.x.size, 1)
        covariance = inverse @ (clustered.T @ clustered) @ inverse
        covariance += inverse * np.square(solution.fun).sum() / degrees_of_freedom
        along, across = np.empty(lights), np.empty(lights)
        for light in range(lights):
            of_light = slice(3 * light, 3 * light + 3)
            unit = solution.x[of_light] / np.linalg.norm(solution.x[of_light])
            along[light] = unit @ covariance[of_light, of_light] @ unit
            across[light] = max(np.trace(covariance[of_light, of_light]) - along[light], 0.0)
        return _ERROR_FACTOR * np.sqrt(along), _ERROR_FACTOR * np.sqrt(across)

    def differences(self, parameters: Any) -> Any:
        """Weighted differences (N n,); complex parameters give complex ones."""
        lights = len(self.data)
        v, exponent = parameters[: 3 * lights].reshape(lights, 3), parameters[-1]
        levels = np.concatenate([[0.0], parameters[3 * lights : -1]])
        along = v[:, :1] * self.x + v[:, 1:2] * self.y
        squares = np.square(v).sum(axis=1)[:, None]
        # |P - X|^2 / |P|^2
        distance_squared = 1.0 - 2.0 * along + squares * (self.x * self.x + self.y * self.y)
        values = levels[:, None] - 0.5 * (3.0 + exponent) * np.log(distance_squared)
        if self.aim == "centre":
            # Beyond a right angle to its axis an LED gives no light; the fit may pass there.
            values += exponent * np.log(np.maximum(1.0 - along, _MIN_FACING))
        return ((values - values.mean(axis=0) - self.data) * self.root_weights).ravel()


def block_sums(values: Floats, size: int) -> Floats:
    """(..., size, size) sums of neighbouring blocks."""
    step = values.shape[-1] // size
    blocks = values.reshape(*values.shape[:-2], size, step, size, step)
    return np.asarray(blocks.sum(axis=(-3, -1)), np.float64)


def _means(values: Floats, size: int) -> Floats:
    """(..., size, size) means of neighbouring blocks."""
    return np.asarray(block_sums(values, size) / (values.shape[-1] // size) ** 2, np.float64)
