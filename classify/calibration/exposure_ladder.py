"""The response of a camera from a ladder of exposures of one still scene.

Block p of the scene gives the light a_p t in the exposure time t. With g the linear light at a
pixel value, g(v) = c + a_p t for all blocks and exposures, where c = g(offset) and the offset is
the pixel value without light. So g follows from the values up to a scale, without knowledge of the
scene (after Debevec and Malik, "Recovering High Dynamic Range Radiance Maps from Photographs",
SIGGRAPH 1997, and Mitsunaga and Nayar, "Radiometric Self Calibration", CVPR 1999, here with known
exposures). Ambient light that does not change is light of the scene.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import lsq_linear

from classify.base.arrays import Floats
from classify.base.errors import CalibrationRejected, InputError

from .calibration import RESPONSE_STEPS, Response

# Cubic pieces between the lowest and the highest value. With 8, gamma, sRGB and filmic curves come
# out within 0.5 % of full scale (tests/classify/calibration/test_exposure_ladder.py).
_PIECES, _DEGREE = 8, 3
# Weight of the differences between neighbouring pieces relative to the residuals. An even sheet has
# few levels: with less weight the curve follows a wrong exposure, with more it is one cubic
# polynomial (the same test has both).
_SMOOTHNESS = 1e-3
# The fit is repeated with weights from its own slope, until its factors change by less than
# `_SETTLED`. Gamma curves need four rounds.
_MAX_ROUNDS, _SETTLED = 12, 1e-7
# Range of slopes that count for the weights, relative to the mean slope. Without the lower limit a
# level could have any weight; without the upper one a steep piece hides the residuals of a wrong
# exposure in it.
_SLOPE_RANGE = (0.02, 6.0)
# Levels between which the light is scaled to rise by 1, as shares of the range. If they were the
# ends of the range, a flat curve with a step at its highest level would have no residuals.
_INNER_RANGE = (0.1, 0.9)
_SCALE_WEIGHT = 1e3  # of the equation of that rise, which the fit meets to rounding
# Limits of the exponent of the power law below the measured values.
_EXPONENTS = (0.25, 4.0)
# Gamma and sRGB curves need five exposures; a sixth shows that one of them is wrong.
_MIN_EXPOSURES = 6
# Least ratio of the longest to the shortest exposure, see _MIN_RISE.
_MIN_RATIO = 4.0
# Share of full scale that the ladder must reach; the curve above is a continuation. The white sheet
# reaches 60 % on a rig whose parts are well exposed, see rig/doctor/light_images.py.
_MIN_TOP = 0.5
# A response of gamma 4 rises by 30 % of its highest value over the least ratio of exposures;
# automatic exposure keeps the value.
_MIN_RISE = 0.2
# Largest fall of the median value at a longer exposure, as a share of full scale: above the noise.
_MAX_FALL = 0.005
# Largest median residual of an exposure, and rms residual of all, as shares of full scale. One
# exposure that is 5 % wrong gives a median of 0.2 to 2.5 %, and exact exposures at most 0.04 %.
# With a larger rms residual, from noise, the curve would miss the required accuracy of 0.5 %.
_MAX_MEDIAN, _MAX_ERROR = 0.002, 0.005
# A curve counts as linear if it departs from a straight line by at most `_NEGLIGIBLE` of full
# scale, which changes the solved slopes by less than 0.1 degrees
# (tests/classify/calibration/test_exposure_ladder.py), or by at most `_SIGNIFICANT` rms errors.
_NEGLIGIBLE, _SIGNIFICANT = 0.002, 3.0


@dataclass(frozen=True, eq=False)
class ExposureLadder:
    """A response and further measures of its ladder."""

    response: Response
    departure: float  # largest distance of the curve from a straight line, share of full scale
    offset: float  # pixel value without light, extrapolated to exposure 0
    lowest: float  # pixel value; the curve below it is a continuation
    highest: float  # pixel value; the curve above it is a continuation


def response_of(values: Floats, exposures_ms: Floats, full_scale: float) -> ExposureLadder:
    """Fit the response to (E, n) mean values of blocks, NaN if clipped, at (E,) exposures."""
    values, times = np.asarray(values, np.float64), np.asarray(exposures_ms, np.float64)
    if values.ndim != 2 or times.shape != values.shape[:1]:
        raise InputError(
            f"{values.shape} values for {times.shape} exposures; give (E, n) values and (E,) times"
        )
    if not (full_scale > 0.0 and np.isfinite(times).all() and (times > 0.0).all()):
        raise InputError(
            f"full scale {full_scale:g}, exposures {times.tolist()}; give positive numbers"
        )
    order = np.argsort(times, kind="stable")
    times, levels = times[order], values[order] / full_scale
    levels = np.where(levels < 1.0, levels, np.nan)
    _check_levels(levels[:, np.isfinite(levels).any(axis=0)], times)
    # A block constrains the curve only if it has two exposures.
    levels = levels[:, np.isfinite(levels).sum(axis=0) > 1]
    fit = _Fit.of(levels, times)
    if not fit.is_consistent:
        raise CalibrationRejected(_cause(levels, times, fit))
    error = fit.error
    curve, offset = fit.curve()
    inside = (fit.lowest <= _GRID) & (fit.highest >= _GRID)
    line = np.polyval(np.polyfit(_GRID[inside], curve[inside], 1), _GRID)
    departure = float(np.abs(curve - line)[inside].max())
    linear = departure <= max(_NEGLIGIBLE, _SIGNIFICANT * error)
    return ExposureLadder(
        Response(_GRID if linear else curve, error, linear),
        departure,
        full_scale * offset,
        full_scale * fit.lowest,
        full_scale * fit.highest,
    )


_GRID = np.linspace(0.0, 1.0, RESPONSE_STEPS + 1)


def _check_levels(levels: Floats, times: Floats) -> None:
    """Reject values that show no response at all."""
    usable = np.isfinite(levels).any(axis=1)
    if not usable.any():
        raise CalibrationRejected(
            "every exposure is saturated or black; use shorter or longer exposures, or close or "
            "open the aperture"
        )
    ladder_ms = np.unique(times[usable])
    first_ms, last_ms = ladder_ms[0], ladder_ms[-1]
    if len(ladder_ms) < _MIN_EXPOSURES or last_ms < _MIN_RATIO * first_ms:
        raise CalibrationRejected(
            f"{len(ladder_ms)} different exposures from {first_ms:g} to {last_ms:g} ms are neither "
            f"saturated nor black; give at least {_MIN_EXPOSURES}, the longest "
            f"{_MIN_RATIO:g} times the shortest"
        )
    rises = np.array([
        np.nan if np.isnan(rise).all() else np.nanmedian(rise) for rise in np.diff(levels, axis=0)
    ])  # fmt: skip
    if np.isnan(rises).all():
        raise CalibrationRejected(
            "at any two neighbouring exposures every part of the frame is saturated or black; "
            "give exposures that differ by less"
        )
    if np.nanmin(rises) < -_MAX_FALL:
        worst = int(np.nanargmin(rises))
        raise CalibrationRejected(
            f"the values fall by {-rises[worst]:.1%} of full scale where the exposure rises from "
            f"{times[worst]:g} to {times[worst + 1]:g} ms; the light changes, or the camera's gain "
            "or exposure is automatic: turn that off and keep other light away"
        )
    top = float(np.nanmax(levels))
    rise = float(np.nanmax(np.nanmax(levels, axis=0) - np.nanmin(levels, axis=0)))
    if rise < _MIN_RISE * top:
        raise CalibrationRejected(
            f"the values do not follow the exposure: they rise by {rise:.1%} of full scale from "
            f"{first_ms:g} to {last_ms:g} ms; turn off the camera's automatic exposure and gain"
        )
    if top < _MIN_TOP:
        raise CalibrationRejected(
            f"the brightest value is {top:.0%} of full scale at {last_ms:g} ms; the response "
            f"above {_MIN_TOP:.0%} must be seen: use longer exposures, or open the aperture"
        )


@dataclass(frozen=True, eq=False)
class _Fit:
    """A monotone cubic spline through the levels, which are shares of full scale."""

    spline: BSpline  # light above that at `lowest`; rises by 1 between two inner levels
    lowest: float
    highest: float
    base: float  # light at `lowest` above that at the offset
    strengths: Floats  # (n,) light of each block per unit of exposure time
    residuals: Floats  # (E, n) differences of the levels from the fit; NaN where a level is

    @classmethod
    def of(cls, levels: Floats, times: Floats) -> "_Fit":
        """Fit a spline with even knots, then one with knots evenly along that curve."""
        lowest, highest = float(np.nanmin(levels)), float(np.nanmax(levels))
        fit = cls._with_knots(levels, times, np.linspace(lowest, highest, _PIECES + 1))
        grid = np.linspace(lowest, highest, RESPONSE_STEPS + 1)
        light = fit.spline(grid)
        lengths = np.hypot(np.diff(grid) / (highest - lowest), np.diff(light) / light[-1])
        arc_length = np.r_[0.0, np.cumsum(lengths)]
        knots = np.interp(np.linspace(0.0, arc_length[-1], _PIECES + 1), arc_length, grid)
        return cls._with_knots(levels, times, knots)

    @classmethod
    def _with_knots(cls, levels: Floats, times: Floats, breakpoints: Floats) -> "_Fit":
        """Fit by least squares in the levels, with weights from the slope of the curve."""
        measured = np.isfinite(levels)
        lowest, highest = float(breakpoints[0]), float(breakpoints[-1])
        inner = lowest + np.array(_INNER_RANGE) * (highest - lowest)
        mean_slope = 1.0 / float(np.ptp(inner))
        knots = np.pad(breakpoints, _DEGREE, mode="edge")
        pieces = _PIECES + _DEGREE
        # I-splines, the sums of the B-splines from the kth to the last: with factors of 0 or more
        # the curve never falls.
        i_splines = BSpline(knots, np.tri(pieces)[:, 1:], _DEGREE)
        slope = i_splines.derivative()
        filled = np.where(measured, levels, lowest)
        terms = np.concatenate([np.ones((*levels.shape, 1)), i_splines(filled)], axis=-1)
        slope_terms, knot_slope_terms = slope(filled), slope(breakpoints[1:-1])
        times = times / times.max()
        # Roughness penalty: jumps of the third derivative at inner breakpoints (Dierckx 1975).
        widths = 0.5 * (breakpoints[2:] - breakpoints[:-2])
        third_derivative_jumps = np.diff(
            i_splines.derivative(3)(0.5 * (breakpoints[1:] + breakpoints[:-1])), axis=0
        )
        roughness = np.zeros((_PIECES - 1, pieces))
        roughness[:, 1:] = _SMOOTHNESS * widths[:, None] ** 3 * third_derivative_jumps
        # The equation that the light rises by 1 between the inner levels.
        scale = np.r_[0.0, np.diff(i_splines(inner), axis=0)[0]][None] * _SCALE_WEIGHT
        bounds = np.r_[0.0, np.full(pieces - 1, 1e-9)]
        slopes, knot_slopes = np.full(levels.shape, mean_slope), np.full(len(roughness), mean_slope)
        factors = np.zeros(pieces)
        for _ in range(_MAX_ROUNDS):
            weights = measured / slopes / np.sqrt(measured.sum())
            # Eliminate the strengths of the blocks by partial regression (Frisch and Waugh 1933):
            # they are `strength_terms` times the factors.
            weights_by_time = np.square(weights) * times[:, None]
            strength_terms = np.einsum("en,enq->nq", weights_by_time, terms)
            strength_terms /= (weights_by_time * times[:, None]).sum(axis=0)[:, None]
            rows = weights[..., None] * (terms - times[:, None, None] * strength_terms)
            upper = np.linalg.qr(rows.reshape(-1, pieces), mode="r")
            system = np.concatenate([upper, roughness / knot_slopes[:, None], scale])
            target = np.r_[np.zeros(len(system) - 1), _SCALE_WEIGHT]
            before, factors = factors, lsq_linear(system, target, (bounds, np.inf), method="bvls").x
            slopes, knot_slopes = (
                np.clip(basis @ factors[1:], *(mean_slope * np.array(_SLOPE_RANGE)))
                for basis in (slope_terms, knot_slope_terms)
            )
            if np.abs(factors - before).max() < _SETTLED:
                break
        strengths = strength_terms @ factors
        residuals = (terms @ factors - times[:, None] * strengths) / slopes
        residuals[~measured] = np.nan
        spline = BSpline(knots, np.r_[0.0, np.cumsum(factors[1:])], _DEGREE)
        return cls(spline, lowest, highest, float(factors[0]), strengths, residuals)

    @property
    def error(self) -> float:
        """Root mean square residual, as a share of full scale."""
        return float(np.sqrt(np.nanmean(np.square(self.residuals))))

    @property
    def medians(self) -> Floats:
        """(E,) median residual of each exposure; 0 where it has no levels."""
        medians = np.zeros(len(self.residuals))
        measured = np.isfinite(self.residuals).any(axis=1)
        medians[measured] = np.nanmedian(self.residuals[measured], axis=1)
        return medians

    @property
    def is_consistent(self) -> bool:
        """Whether one curve explains all exposures."""
        return bool(np.abs(self.medians).max() <= _MAX_MEDIAN and self.error <= _MAX_ERROR)

    def exposure_of(self, levels: Floats) -> float:
        """The exposure, as a share of the longest, that explains (n,) levels of the blocks."""
        light = self.base + self.spline(np.clip(levels, self.lowest, self.highest))
        return float(np.nanmedian(light / self.strengths))

    def curve(self) -> tuple[Floats, float]:
        """The curve on `_GRID`, from 0 to 1, and the offset."""
        lowest, highest = self.lowest, self.highest
        slope = self.spline.derivative()
        near, far = lowest + np.array([0.02, 0.25]) * (highest - lowest)
        # The derivative of v^k has the exponent k - 1.
        slope_exponent = np.log(float(slope(far)) / float(slope(near))) / np.log(far / near)
        exponent = np.clip(1.0 + slope_exponent, *_EXPONENTS)
        bottom = lowest * float(slope(lowest)) / exponent
        top = bottom + float(self.spline(highest))
        light = bottom + self.spline(np.clip(_GRID, lowest, highest))
        below, above = lowest > _GRID, highest < _GRID
        light[below] = bottom * (_GRID[below] / lowest) ** exponent
        light[above] = top * (_GRID[above] / highest) ** (highest * float(slope(highest)) / top)
        # Rounding may have made the spline fall by some 1e-16.
        light = np.maximum.accumulate(np.maximum(light, 0.0))
        offset = float(np.interp((bottom - self.base) / light[-1], light / light[-1], _GRID))
        return light / light[-1], offset


def _cause(levels: Floats, times: Floats, fit: _Fit) -> str:
    """Describe why no curve explains the values: one exposure, or all."""
    cause = (
        f"no response explains the values: they depart by up to {np.abs(fit.medians).max():.1%} of "
        "full scale from the best; the camera's exposure or gain is automatic, or the light changes"
    )
    exposures = np.flatnonzero(np.isfinite(levels).any(axis=1))
    # The wrong exposure is the one without which the others agree best.
    best = fit
    for left_out in exposures if len(exposures) > _MIN_EXPOSURES else ():
        others = np.delete(np.arange(len(times)), left_out)
        enough = np.isfinite(levels[others]).sum(axis=0) > 1
        refit = _Fit.of(levels[np.ix_(others, enough)], times[others])
        if refit.is_consistent and refit.error < best.error:
            best = refit
            effective_ms = refit.exposure_of(levels[left_out, enough]) * times[others].max()
            cause = (
                f"an exposure of {times[left_out]:g} ms acts as one of {effective_ms:.3g} ms; the "
                "camera does not keep its exposure, or the light flickers"
            )
    return cause
