"""Model of how changes of a rig change its light images of a sheet.

The change is the logarithm of a light image over the flat field, by light and block of the frame.
Changes that need no cause, such as noise and the place of the sheet, have normal distributions.
Each cause adds a few parameters with wider normal distributions. Causes are added as long as they
make the change more probable (Laplace's approximation: MacKay 2003, Information Theory, chapter
28).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import least_squares

from classify.base.arrays import Floats
from classify.images import SIGMA_PER_MAD

from .led_positions import Aim

Kind = Literal[
    "led level", "light moved", "camera moved", "leds rotated", "lens", "exposure", "sheet tilted"
]

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
_TOLERANCE = 1e-3  # relative, of the fitted parameters
_NO_SLOPE: Floats = np.zeros(2)
_MIN_LIGHT_Z = 0.02  # least z of a unit vector: no light of a fit sinks below the plane


@dataclass(frozen=True, eq=False)
class PossibleCause:
    """One thing that may have changed."""

    kind: Kind
    light: int | None  # index; None for a change that all lights share
    spreads: tuple[float, ...]  # standard deviations of the parameters of the cause
    change: Callable[[Floats], Floats]  # the change (N, B) for these parameters
    quarter_turns: int = 0  # of "leds rotated"; the parameters are the departure from it


@dataclass(frozen=True, eq=False)
class Explanation:
    """The most probable causes of a change, each with its parameters."""

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
        self._nuisance_estimator = nuisances @ self._whitener.T @ self._whitener
        self._nuisance_changes = nuisances
        self._causes = tuple(self._all_causes())

    def explain(self, change: Floats) -> Explanation:
        """The causes of a change (N, B), at most three, by stepwise selection with exchanges."""
        chosen: tuple[PossibleCause, ...] = ()
        score, parameters = self._fit(change, chosen, np.empty(0))
        while len(chosen) < _MAX_CAUSES:
            extended = self._best(change, chosen, parameters)
            for index in range(len(chosen)):
                # An earlier cause may have been a substitute for the causes chosen later.
                causes, _, fitted = extended
                others = causes[:index] + causes[index + 1 :]
                exchanged = self._best(change, others, _without(fitted, causes, index))
                if exchanged[1] < extended[1]:
                    extended = exchanged
            if extended[1] >= score:
                break
            chosen, score, parameters = extended
        return self._explanation(change, chosen, parameters)

    def shows_moved_lights(self, angle: float) -> bool:
        """Whether the model would report a move of any light by `angle` radians along its tilt."""
        no_parameters = np.empty(0)
        for cause in self._causes:
            if cause.kind == "light moved":
                parameters = np.array([angle, 0.0, 0.0])
                change = cause.change(parameters)
                score_without, _ = self._fit(change, (), no_parameters)
                if self._fit(change, (cause,), parameters)[0] >= score_without:
                    return False
        return True

    def _best(
        self, change: Floats, chosen: tuple[PossibleCause, ...], parameters: Floats
    ) -> tuple[tuple[PossibleCause, ...], float, Floats]:
        """Add the best cause to `chosen`; also return the score of `_fit` and all parameters."""
        fits = []
        for cause in self._causes:
            if cause not in chosen:
                extended = (*chosen, cause)
                start = np.append(parameters, np.zeros(len(cause.spreads)))
                fits.append((extended, *self._fit(change, extended, start)))
        return min(fits, key=lambda fit: fit[1])

    def _fit(
        self, change: Floats, causes: Sequence[PossibleCause], start: Floats
    ) -> tuple[float, Floats]:
        """Score of causes, minus twice their log evidence up to a constant, and parameters."""

        def differences(scaled: Floats) -> Floats:
            """Whitened residuals, and the parameters in standard deviations."""
            unexplained = change - self._change(causes, scaled * spreads)
            return np.append(self._whitener @ unexplained.ravel(), scaled)

        spreads = np.array([spread for cause in causes for spread in cause.spreads])
        if not causes:
            return float(np.square(differences(start)).sum()), start
        fit = least_squares(differences, start / spreads, method="lm", xtol=_TOLERANCE)
        log_determinant = float(np.linalg.slogdet(fit.jac.T @ fit.jac)[1])
        odds = sum(
            _LOG_ODDS_TILT if cause.kind == "sheet tilted" else _LOG_ODDS for cause in causes
        )
        return 2.0 * (fit.cost + odds) + log_determinant, fit.x * spreads

    def _change(self, causes: Sequence[PossibleCause], parameters: Floats) -> Floats:
        """(N, B) sum of the changes by causes."""
        total, first = np.zeros_like(self._strengths), 0
        for cause in causes:
            last = first + len(cause.spreads)
            total += cause.change(parameters[first:last])
            first = last
        return total

    def _explanation(
        self, change: Floats, causes: tuple[PossibleCause, ...], parameters: Floats
    ) -> Explanation:
        unexplained = change - self._change(causes, parameters)
        # Posterior means, in standard deviations.
        nuisances = self._nuisance_estimator @ unexplained.ravel()
        remainder = unexplained - (nuisances @ self._nuisance_changes).reshape(unexplained.shape)
        brightness = _WHITE_SPREAD * float(nuisances[0])
        slope = _TILT_SPREAD * nuisances[1:3]
        levels = _LEVEL_SPREAD * nuisances[3 : 3 + len(change)]
        with_parameters, first = [], 0
        for cause in causes:
            cause_parameters = parameters[first : first + len(cause.spreads)]
            first += len(cause_parameters)
            with_parameters.append((cause, cause_parameters))
            if cause.kind == "led level" and cause.light is not None:
                levels[cause.light] += cause_parameters[0]
            elif cause.kind == "exposure":
                brightness += float(cause_parameters[0])
            elif cause.kind == "sheet tilted":
                slope += cause_parameters
        shared = remainder.mean(axis=0)
        residual = float(np.sqrt(np.square(remainder - shared).mean()))
        unevenness = SIGMA_PER_MAD * float(np.median(np.abs(shared)))
        return Explanation(tuple(with_parameters), levels, brightness, slope, residual, unevenness)

    def _nuisances(self) -> Iterator[Floats]:
        """Yield the change (N B,) by one standard deviation of each nuisance."""
        # Nuisances need no cause. `_explanation` relies on their order: brightness, slopes, levels,
        # others.
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
        movement = (0.3, 0.3, 0.2)
        yield PossibleCause("camera moved", None, movement, self._camera_change)
        # Steps from a camera in its place do not reach these angles.
        for quarters in (1, 2, 3):
            change = partial(self._camera_change, quarter_turns=quarters)
            yield PossibleCause("leds rotated", None, movement, change, quarters)
        yield PossibleCause("lens", None, (0.2, 0.1, 0.05), self._lens_change)
        yield PossibleCause("exposure", None, (0.7,), self._exposure_change)
        yield PossibleCause("sheet tilted", None, (0.15, 0.15), self._tilt_change)

    def _all_blocks(self, values: npt.ArrayLike) -> Floats:
        """Broadcast a value, or one for each light (N, 1), to (N, B)."""
        return np.zeros_like(self._strengths) + np.asarray(values, np.float64)

    def _exposure_change(self, parameters: Floats) -> Floats:
        """Parameters: logarithm of the brightness of all lights."""
        return self._all_blocks(parameters[0])

    def _level_change(self, light: int) -> Callable[[Floats], Floats]:
        single_light = np.eye(len(self.positions))[:, light, None]
        return lambda parameters: self._all_blocks(parameters[0] * single_light)

    def _light_change(self, light: int) -> Callable[[Floats], Floats]:
        """Parameters: two angles in radians, and the logarithm of the distance."""

        def change(parameters: Floats) -> Floats:
            moved = self._all_blocks(0.0)
            position = moved_light(self.positions[light], parameters)
            moved[light] = self._strength(position, self._x, self._y) - self._strengths[light]
            return moved

        return change

    def _camera_change(self, parameters: Floats, quarter_turns: int = 0) -> Floats:
        """Parameters: shift along x and y, angle in radians anticlockwise, of the camera."""
        angle = parameters[2] + 0.5 * np.pi * quarter_turns
        cosine, sine = np.cos(angle), np.sin(angle)
        x = cosine * self._x - sine * self._y + parameters[0]
        y = sine * self._x + cosine * self._y + parameters[1]
        return self._all_strengths(x, y) - self._strengths

    def _lens_change(self, parameters: Floats) -> Floats:
        """Parameters: logarithm of the magnification, vignetting by radius^2 and radius^4."""
        scale = float(np.exp(-parameters[0]))
        vignetting = parameters[1] * self._radius_2 + parameters[2] * self._radius_2**2
        magnified = self._all_strengths(scale * self._x, scale * self._y)
        return np.asarray(magnified - self._strengths + vignetting, np.float64)

    def _tilt_change(self, parameters: Floats) -> Floats:
        """Parameters: slope of the sheet along x and y; its middle stays in place."""
        return self._all_strengths(self._x, self._y, parameters) - self._strengths

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
    to_led = np.stack([position[0] - x, position[1] - y, position[2] - z])
    squared = np.square(to_led).sum(axis=0)
    height = (position[2] - position[:2] @ slope) / math.sqrt(1.0 + float(slope @ slope))
    axis = position / np.linalg.norm(position) if aim == "centre" else np.array([0.0, 0.0, 1.0])
    cosine = np.maximum(axis @ to_led / np.sqrt(squared), _MIN_LIGHT_Z)
    light = math.log(max(height, 1e-9)) - 1.5 * np.log(squared) + lobe_exponent * np.log(cosine)
    return np.asarray(light, np.float64)


def moved_light(position: Floats, parameters: Floats) -> Floats:
    """(3,) position after rotation along the tilt, raising (radians) and a change of distance."""
    distance = float(np.linalg.norm(position))
    towards = position / distance
    across = np.array([-towards[1], towards[0], 0.0])
    length = float(np.linalg.norm(across))
    across = across / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    moved = towards + parameters[0] * across + parameters[1] * np.cross(towards, across)
    moved[2] = max(moved[2], _MIN_LIGHT_Z)
    new_distance = distance * np.exp(parameters[2])
    return np.asarray(moved * (new_distance / np.linalg.norm(moved)), np.float64)


def _without(parameters: Floats, causes: Sequence[PossibleCause], index: int) -> Floats:
    """Remove the parameters of the cause at `index`."""
    ends = np.cumsum([len(cause.spreads) for cause in causes])
    return np.delete(parameters, slice(ends[index] - len(causes[index].spreads), ends[index]))
