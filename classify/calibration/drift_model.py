"""Model of how changes of a rig change its light images of a sheet.

The change is the logarithm of a light image over the flat field, by light and block of the frame.
Changes that need no cause, such as noise and the place of the sheet, have normal distributions.
Each cause adds a few numbers with wider normal distributions. Causes are added as long as they make
the change more probable (Laplace's approximation: MacKay 2003, Information Theory, chapter 28).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.linalg import cholesky, solve_triangular

from classify.base.arrays import Floats
from classify.images import SIGMA_PER_MAD

from .led_positions import Aim

Kind = Literal["led level", "light moved", "camera moved", "lens", "exposure", "sheet tilted"]

# Standard deviations of logarithms in a block: of the ratio of lights (noise and misfit of the flat
# field), and of the common part of all lights (also grain and dust of the sheet).
_RATIO_SPREAD, _COMMON_SPREAD = 0.0015, 0.01
# Another white sheet: brightness (paper reflects 75 to 95 %), and smooth unevenness.
_WHITE_SPREAD, _UNEVEN_SPREAD = 0.07, 0.01
# Slope of a sheet, and slope at the edge of the frame of a bowed one (0.13 mm in 50 mm).
_TILT_SPREAD, _BOW_SPREAD = 0.009, 0.01
# Level of an LED, gradient and curvature of its light, without a cause worth a warning: its
# temperature, another paper's sheen.
_LEVEL_SPREAD, _GRADIENT_SPREAD, _CURVATURE_SPREAD = 0.01, 0.001, 0.0005
# Natural logarithm of the odds against a cause, and against a tilted sheet, rare on a table.
# tests/evidence/drift_rates.py counts which causes are mistaken for others.
_LOG_ODDS, _LOG_ODDS_TILT = 3.0, 6.0
_MAX_CAUSES = 3
# Gauss-Newton, in standard deviations of the numbers: step of derivatives and of convergence,
# longest step; and the largest number of steps.
_STEP, _MAX_STEP, _MAX_STEPS = 1e-3, 1.0, 12
_NO_SLOPE: Floats = np.zeros(2)
_MIN_LIGHT_Z = 0.02  # least z of a unit vector: no light of a fit sinks below the plane


@dataclass(frozen=True, eq=False)
class PossibleCause:
    """One thing that may have changed."""

    kind: Kind
    light: int | None  # index; None for a change that all lights share
    spreads: tuple[float, ...]  # standard deviations of the numbers of the cause
    change: Callable[[Floats], Floats]  # the change (N, B) for these numbers


@dataclass(frozen=True, eq=False)
class Explanation:
    """The most probable causes of a change, each with its numbers."""

    causes: tuple[tuple[PossibleCause, Floats], ...]
    levels: Floats  # (N,) logarithm of each light's level, without the common part
    brightness: float  # logarithm of the brightness that all lights share
    slope: Floats  # (2,) of the sheet along x and y
    residual: float  # rms of the unexplained ratios of lights
    unevenness: float  # robust standard deviation of the unexplained common part


class DriftModel:
    """The sheet under lights at (N, 3) positions, in blocks with (B,) middles x and y."""

    def __init__(
        self, positions: Floats, lobe_exponent: float, aim: Aim, x: Floats, y: Floats
    ) -> None:
        self.positions, self._lobe_exponent, self._aim = positions, lobe_exponent, aim
        self._x, self._y = x, y
        self._radius_2 = (x * x + y * y) / float((x * x + y * y).max())
        self._tangents = positions[:, :2] / positions[:, 2:]
        self._strengths = self._all_strengths(x, y)
        nuisances = np.array(list(self._nuisances()))
        lights, blocks = self._strengths.shape
        shared = np.kron(np.ones((lights, lights)), np.eye(blocks))
        identity = np.eye(lights * blocks)
        covariance = nuisances.T @ nuisances + _RATIO_SPREAD**2 * identity
        covariance += _COMMON_SPREAD**2 * shared
        lower = cholesky(covariance, lower=True)
        self._whitener = solve_triangular(lower, identity, lower=True)
        self._posterior = nuisances @ self._whitener.T @ self._whitener
        self._nuisance_changes = nuisances
        self._causes = tuple(self._all_causes())

    def explain(self, change: Floats) -> Explanation:
        """The causes of a change (N, B), at most three, by stepwise selection with exchanges."""
        chosen: tuple[PossibleCause, ...] = ()
        score, numbers = self._fit(change, chosen, np.empty(0))
        while len(chosen) < _MAX_CAUSES:
            longer, better, fitted = self._best(change, chosen, numbers)
            for index in range(len(longer) - 1):
                # An earlier cause may have been a substitute for the causes chosen later.
                others = longer[:index] + longer[index + 1 :]
                exchanged = self._best(change, others, _without(fitted, longer, index))
                if exchanged[1] < better:
                    longer, better, fitted = exchanged
            if better >= score:
                break
            chosen, score, numbers = longer, better, fitted
        return self._explanation(change, chosen, numbers)

    def shows_moved_lights(self, angle: float) -> bool:
        """Whether a move of any light by `angle` radians along its tilt would be named."""
        still = np.empty(0)
        for cause in self._causes:
            if cause.kind == "light moved":
                numbers = np.array([angle, 0.0, 0.0])
                change = cause.change(numbers)
                unnamed, _ = self._fit(change, (), still)
                if self._fit(change, (cause,), numbers)[0] >= unnamed:
                    return False
        return True

    def _best(
        self, change: Floats, chosen: tuple[PossibleCause, ...], numbers: Floats
    ) -> tuple[tuple[PossibleCause, ...], float, Floats]:
        """Add the best cause to `chosen`; also return the score and all numbers."""
        fits = []
        for cause in self._causes:
            if cause not in chosen:
                longer = (*chosen, cause)
                start = np.append(numbers, np.zeros(len(cause.spreads)))
                fits.append((longer, *self._fit(change, longer, start)))
        return min(fits, key=lambda fit: fit[1])

    def _fit(
        self, change: Floats, causes: Sequence[PossibleCause], start: Floats
    ) -> tuple[float, Floats]:
        """Minus twice the log evidence of causes, up to a constant, and their numbers."""
        spreads = np.array([spread for cause in causes for spread in cause.spreads])
        scaled, predicted = start / spreads, self._change(causes, start)
        odds = sum(
            _LOG_ODDS_TILT if cause.kind == "sheet tilted" else _LOG_ODDS for cause in causes
        )
        residual, volume = self._whitener @ (change - predicted).ravel(), 0.0
        for _ in range(_MAX_STEPS if causes else 0):
            slopes = [
                self._whitener
                @ (self._change(causes, (scaled + shift) * spreads) - predicted).ravel()
                for shift in _STEP * np.eye(len(spreads))
            ]
            jacobian = np.stack(slopes, axis=1) / _STEP
            precision = jacobian.T @ jacobian + np.eye(len(spreads))
            step = np.linalg.solve(precision, jacobian.T @ residual - scaled)
            volume = float(np.linalg.slogdet(precision)[1])
            scaled = scaled + np.clip(step, -_MAX_STEP, _MAX_STEP)
            predicted = self._change(causes, scaled * spreads)
            residual = self._whitener @ (change - predicted).ravel()
            if np.abs(step).max() < _STEP:
                break
        return float(residual @ residual + scaled @ scaled) + 2.0 * odds + volume, scaled * spreads

    def _change(self, causes: Sequence[PossibleCause], numbers: Floats) -> Floats:
        total, first = np.zeros_like(self._strengths), 0
        for cause in causes:
            last = first + len(cause.spreads)
            total += cause.change(numbers[first:last])
            first = last
        return total

    def _explanation(
        self, change: Floats, causes: tuple[PossibleCause, ...], numbers: Floats
    ) -> Explanation:
        unexplained = change - self._change(causes, numbers)
        nuisances = self._posterior @ unexplained.ravel()
        remainder = unexplained - (nuisances @ self._nuisance_changes).reshape(unexplained.shape)
        brightness = _WHITE_SPREAD * float(nuisances[0])
        slope = _TILT_SPREAD * nuisances[1:3]
        levels = _LEVEL_SPREAD * nuisances[3 : 3 + len(change)]
        with_numbers, first = [], 0
        for cause in causes:
            cause_numbers = numbers[first : first + len(cause.spreads)]
            first += len(cause_numbers)
            with_numbers.append((cause, cause_numbers))
            if cause.kind == "led level" and cause.light is not None:
                levels[cause.light] += cause_numbers[0]
            elif cause.kind == "exposure":
                brightness += float(cause_numbers[0])
            elif cause.kind == "sheet tilted":
                slope += cause_numbers
        shared = remainder.mean(axis=0)
        residual = float(np.sqrt(np.square(remainder - shared).mean()))
        unevenness = SIGMA_PER_MAD * float(np.median(np.abs(shared)))
        return Explanation(tuple(with_numbers), levels, brightness, slope, residual, unevenness)

    def _nuisances(self) -> Iterator[Floats]:
        """(N B,) changes that need no cause, in standard deviations: brightness, slope, levels,
        others.
        """
        x, y, one = self._x, self._y, np.ones_like(self._x)
        along_x, along_y = self._tangents.T[..., None]
        all_lights = np.ones((len(self.positions), 1))
        yield (_WHITE_SPREAD * all_lights * one).ravel()
        for slope in _TILT_SPREAD * np.eye(2):
            yield self._tilt_change(slope).ravel()
        single_lights = np.eye(len(self.positions))[..., None]
        for light in single_lights:
            yield (_LEVEL_SPREAD * light * one).ravel()
        for term in (x, y, x * x, x * y, y * y):
            yield (_UNEVEN_SPREAD * all_lights * term).ravel()
        for bow in (along_x * x, along_y * y, along_x * y + along_y * x):
            yield (-_BOW_SPREAD * bow).ravel()
        for light in single_lights:
            for term in (x, y):
                yield (_GRADIENT_SPREAD * light * term).ravel()
            for term in (x * x, x * y, y * y):
                yield (_CURVATURE_SPREAD * light * term).ravel()

    def _all_causes(self) -> Iterator[PossibleCause]:
        # The spreads are at least the limits of a fault in `drift`, so that the images decide.
        for light in range(len(self.positions)):
            yield PossibleCause("led level", light, (0.3,), self._level_change(light))
            yield PossibleCause("light moved", light, (0.2, 0.2, 0.2), self._light_change(light))
        yield PossibleCause("camera moved", None, (0.3, 0.3, 0.2), self._camera_change)
        yield PossibleCause("lens", None, (0.2, 0.1, 0.05), self._lens_change)
        yield PossibleCause("exposure", None, (0.7,), lambda numbers: self._even(numbers[0]))
        yield PossibleCause("sheet tilted", None, (0.15, 0.15), self._tilt_change)

    def _even(self, values: npt.ArrayLike) -> Floats:
        """(N, B) the same value in all blocks."""
        return np.zeros_like(self._strengths) + np.asarray(values, np.float64)

    def _level_change(self, light: int) -> Callable[[Floats], Floats]:
        single_light = np.eye(len(self.positions))[:, light, None]
        return lambda numbers: self._even(numbers[0] * single_light)

    def _light_change(self, light: int) -> Callable[[Floats], Floats]:
        """Numbers: two angles in radians, and the logarithm of the distance."""

        def change(numbers: Floats) -> Floats:
            moved = self._even(0.0)
            position = moved_light(self.positions[light], numbers)
            moved[light] = self._strength(position, self._x, self._y) - self._strengths[light]
            return moved

        return change

    def _camera_change(self, numbers: Floats) -> Floats:
        """Numbers: shift along x and y, angle in radians anticlockwise, of the camera."""
        cosine, sine = np.cos(numbers[2]), np.sin(numbers[2])
        x = cosine * self._x - sine * self._y + numbers[0]
        y = sine * self._x + cosine * self._y + numbers[1]
        return self._all_strengths(x, y) - self._strengths

    def _lens_change(self, numbers: Floats) -> Floats:
        """Numbers: logarithm of the magnification, vignetting by radius^2 and radius^4."""
        field = float(np.exp(-numbers[0]))
        vignetting = numbers[1] * self._radius_2 + numbers[2] * self._radius_2**2
        magnified = self._all_strengths(field * self._x, field * self._y)
        return np.asarray(magnified - self._strengths + vignetting, np.float64)

    def _tilt_change(self, numbers: Floats) -> Floats:
        """Numbers: slope of the sheet along x and y; its middle stays in place."""
        return self._all_strengths(self._x, self._y, numbers) - self._strengths

    def _all_strengths(self, x: Floats, y: Floats, slope: Floats = _NO_SLOPE) -> Floats:
        return np.array([self._strength(position, x, y, slope) for position in self.positions])

    def _strength(
        self, position: Floats, x: Floats, y: Floats, slope: Floats = _NO_SLOPE
    ) -> Floats:
        return led_strength(position, self._lobe_exponent, self._aim, x, y, slope)


def led_strength(
    position: Floats,
    lobe_exponent: float,
    aim: Aim,
    x: Floats,
    y: Floats,
    slope: Floats = _NO_SLOPE,
) -> Floats:
    """(B,) logarithm of the light of an LED on a plane: inverse square, Lambert, lobe."""
    z = slope[0] * x + slope[1] * y
    away = np.stack([position[0] - x, position[1] - y, position[2] - z])
    squared = np.square(away).sum(axis=0)
    facing = (position[2] - position[:2] @ slope) / math.sqrt(1.0 + float(slope @ slope))
    axis = position / np.linalg.norm(position) if aim == "centre" else np.array([0.0, 0.0, 1.0])
    towards = np.maximum(axis @ away / np.sqrt(squared), _MIN_LIGHT_Z)
    light = math.log(max(facing, 1e-9)) - 1.5 * np.log(squared) + lobe_exponent * np.log(towards)
    return np.asarray(light, np.float64)


def moved_light(position: Floats, numbers: Floats) -> Floats:
    """(3,) position after rotation along the tilt, raising (radians) and a change of distance."""
    distance = float(np.linalg.norm(position))
    towards = position / distance
    across = np.array([-towards[1], towards[0], 0.0])
    length = float(np.linalg.norm(across))
    across = across / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    moved = towards + numbers[0] * across + numbers[1] * np.cross(towards, across)
    moved[2] = max(moved[2], _MIN_LIGHT_Z)
    return np.asarray(moved * (distance * np.exp(numbers[2]) / np.linalg.norm(moved)), np.float64)


def _without(numbers: Floats, causes: Sequence[PossibleCause], place: int) -> Floats:
    """Remove the numbers of the cause at `place`."""
    ends = np.cumsum([len(cause.spreads) for cause in causes])
    return np.delete(numbers, slice(ends[place] - len(causes[place].spreads), ends[place]))
